/* Two amplifiers, a brake on a coil and contacts on discrete inputs, on libmodbus: another stack than any of ours.
 *
 * Prints its port. The line "freeze" on standard input stops the counters, "run" lets them go on; its end is ours.
 * Registers: those of the profiles float-torques, float-angles and coil-brake; contacts are discrete inputs 0 and 1. */
#include <arpa/inet.h>
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <string.h>
#include <sys/select.h>
#include <unistd.h>

enum { COIL = 16, TORQUES = 200, ANGLES = 0, SECOND = 100 };

static modbus_mapping_t *map;
static uint32_t cycle;

static void put_u32(uint16_t *to, uint32_t value) /* the less significant word first */
{
    to[0] = value & 0xFFFF;
    to[1] = value >> 16;
}

static void put_float(uint16_t *to, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_u32(to, bits);
}

static void measure(int counts)
{
    uint16_t *torques = map->tab_registers, *angles = map->tab_input_registers;
    cycle += counts;
    put_u32(torques, cycle);
    put_float(torques + 2, 1.5f);                                /* N·m */
    put_float(torques + 6, map->tab_bits[0] ? -0.25f : 0.0f);    /* kN·m, once the lock is closed */
    angles[0] = 'E' << 8 | 'N';
    angles[1] = 'C' << 8 | '2';
    put_u32(angles + 2, 1000 * cycle);
    put_float(angles + 4, 90.0f);
    put_u32(angles + SECOND, 1000 * cycle);
    put_float(angles + SECOND + 2, -45.0f);
    map->tab_input_bits[0] = map->tab_input_bits[1] = 1;
}

int main(void)
{
    uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
    char said[64];
    struct sockaddr_in where;
    socklen_t size = sizeof where;
    fd_set watched, ready;
    int counts = 1, last, listening;
    modbus_t *context = modbus_new_tcp("127.0.0.1", 0);

    map = modbus_mapping_new_start_address(COIL, 1, 0, 2, TORQUES, 8, ANGLES, SECOND + 4);
    if (context == NULL || map == NULL || (listening = modbus_tcp_listen(context, 8)) < 0) {
        fprintf(stderr, "libmodbus: %s\n", modbus_strerror(errno));
        return 1;
    }
    getsockname(listening, (struct sockaddr *)&where, &size);
    printf("%d\n", ntohs(where.sin_port));
    fflush(stdout);
    FD_ZERO(&watched);
    FD_SET(STDIN_FILENO, &watched);
    FD_SET(listening, &watched);
    last = listening;
    for (;;) {
        ready = watched;
        if (select(last + 1, &ready, NULL, NULL, NULL) < 0)
            return 1;
        for (int one = 0; one <= last; one++) {
            if (!FD_ISSET(one, &ready))
                continue;
            if (one == STDIN_FILENO) {
                ssize_t length = read(one, said, sizeof said - 1);
                if (length <= 0)
                    return 0;
                said[length] = 0;
                counts = strncmp(said, "freeze", 6) != 0;
            } else if (one == listening) {
                int client = accept(listening, NULL, NULL);
                FD_SET(client, &watched);
                last = client > last ? client : last;
            } else {
                int length;
                modbus_set_socket(context, one);
                length = modbus_receive(context, request);
                if (length > 0) {
                    measure(counts);
                    modbus_reply(context, request, length, map);
                } else if (length < 0) {
                    close(one);
                    FD_CLR(one, &watched);
                }
            }
        }
    }
}
