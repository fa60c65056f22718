/* Devices on libmodbus between a controller and the virtual bench: what the controller speaks with is not of ours.
 *
 * Arguments: the ports of the bench's devices. Prints a port for each, in their order, one line. Each connection is a
 * process of its own, because the bench may hold one device's answer back until it has heard another's request. Every
 * request is decoded and answered by libmodbus; the values are those that the bench has at that moment. The end of
 * standard input is the end. */
#include <arpa/inet.h>
#include <errno.h>
#include <modbus.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/select.h>
#include <unistd.h>

enum { MOST = 16, ALL = 0x10000, UNIT = 6, FUNCTION = 7, ADDRESS = 8, COUNT = 10 };

static int word(const uint8_t *at)
{
    return at[0] << 8 | at[1];
}

/* Fetch from the bench what is asked for, or give it what is written; less than 0 where it refuses or is gone. */
static int at_the_bench(modbus_t *bench, const uint8_t *request, modbus_mapping_t *map)
{
    int address = word(request + ADDRESS), count = word(request + COUNT);
    modbus_set_slave(bench, request[UNIT]);
    switch (request[FUNCTION]) {
    case MODBUS_FC_READ_COILS:
        return modbus_read_bits(bench, address, count, map->tab_bits + address);
    case MODBUS_FC_READ_DISCRETE_INPUTS:
        return modbus_read_input_bits(bench, address, count, map->tab_input_bits + address);
    case MODBUS_FC_READ_HOLDING_REGISTERS:
        return modbus_read_registers(bench, address, count, map->tab_registers + address);
    case MODBUS_FC_READ_INPUT_REGISTERS:
        return modbus_read_input_registers(bench, address, count, map->tab_input_registers + address);
    case MODBUS_FC_WRITE_SINGLE_COIL:
        return modbus_write_bit(bench, address, map->tab_bits[address]);
    case MODBUS_FC_WRITE_SINGLE_REGISTER:
        return modbus_write_register(bench, address, map->tab_registers[address]);
    case MODBUS_FC_WRITE_MULTIPLE_COILS:
        return modbus_write_bits(bench, address, count, map->tab_bits + address);
    case MODBUS_FC_WRITE_MULTIPLE_REGISTERS:
        return modbus_write_registers(bench, address, count, map->tab_registers + address);
    }
    return 0; /* modbus_reply refuses it */
}

static int serve(int connection, int port)
{
    uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
    modbus_t *controller = modbus_new_tcp("127.0.0.1", 0), *bench = modbus_new_tcp("127.0.0.1", port);
    modbus_mapping_t *map = modbus_mapping_new(ALL, ALL, ALL, ALL);
    if (controller == NULL || map == NULL || bench == NULL || modbus_connect(bench) < 0)
        return 1;
    modbus_set_response_timeout(bench, 5, 0);
    modbus_set_socket(controller, connection);
    for (;;) {
        int length = modbus_receive(controller, request);
        if (length < 0)
            return 0;
        if (length == 0)
            continue;
        int reads = request[FUNCTION] <= MODBUS_FC_READ_INPUT_REGISTERS;
        if (reads && at_the_bench(bench, request, map) < 0)
            return 1;
        modbus_reply(controller, request, length, map); /* of a write: what was written is in the map now */
        if (!reads && at_the_bench(bench, request, map) < 0)
            return 1;
    }
}

int main(int devices, char **ports)
{
    int listening[MOST], last = STDIN_FILENO;
    signal(SIGCHLD, SIG_IGN);
    for (int one = 1; one < devices && one < MOST; one++) {
        struct sockaddr_in where;
        socklen_t size = sizeof where;
        modbus_t *context = modbus_new_tcp("127.0.0.1", 0);
        if (context == NULL || (listening[one] = modbus_tcp_listen(context, 8)) < 0) {
            fprintf(stderr, "libmodbus: %s\n", modbus_strerror(errno));
            return 1;
        }
        getsockname(listening[one], (struct sockaddr *)&where, &size);
        printf("%d ", ntohs(where.sin_port));
        last = listening[one] > last ? listening[one] : last;
    }
    printf("\n");
    fflush(stdout);
    for (;;) {
        char said;
        fd_set ready;
        FD_ZERO(&ready);
        FD_SET(STDIN_FILENO, &ready);
        for (int one = 1; one < devices; one++)
            FD_SET(listening[one], &ready);
        if (select(last + 1, &ready, NULL, NULL, NULL) < 0)
            return 1;
        if (FD_ISSET(STDIN_FILENO, &ready) && read(STDIN_FILENO, &said, 1) <= 0)
            return 0;
        for (int one = 1; one < devices; one++)
            if (FD_ISSET(listening[one], &ready)) {
                int connection = accept(listening[one], NULL, NULL);
                if (connection >= 0 && fork() == 0) {
                    close(STDIN_FILENO);
                    _exit(serve(connection, atoi(ports[one])));
                }
                close(connection);
            }
    }
}
