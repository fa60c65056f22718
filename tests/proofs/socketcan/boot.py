"""`make test-socketcan`: boots a Linux kernel that has a real SocketCAN bus, as a user's process, and tests on it.

Debian builds the kernel for User Mode Linux: it needs no right and no virtual machine, runs at the speed of this one,
and sees its files read-only, so nothing has to be installed in it. Where it cannot be had, one line says so and the
exit code is 0. The kernel and busybox come from Debian's archive by `apt-get download` and are kept in the cache.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[3]
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "lostmotion-socketcan"
PACKAGES = ("user-mode-linux", "busybox-static")
LONGEST_S = int(os.environ.get("SOCKETCAN_SECONDS", "300"))
TIMED_OUT = 124
MODULES = ("net/can/can", "net/can/can-raw", "drivers/net/can/dev/can-dev", "drivers/net/can/vcan")
"""In the order in which they need each other."""

KERNEL = ("mem=3G", "rootfstype=hostfs", "rootflags=/", "ro", "quiet", "con=null", "con0=null,fd:1")

INIT = """#!/bin/sh
export PATH={path} HOME=/run TMPDIR=/run LOSTMOTION_STATE=/run/state PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1
say() {{ {busybox} echo "guest: $*"; }}
{busybox} mount -t proc none /proc
{busybox} mount -t sysfs none /sys
{busybox} mount -t tmpfs none /run
{busybox} mkdir -p /dev/shm /dev/pts
{busybox} mount -t tmpfs none /dev/shm
{busybox} mount -t devpts none /dev/pts
for module in {modules}; do {busybox} insmod $module || say "no $module"; done
{busybox} ip link set lo up
{busybox} ip link add dev vcan0 type vcan
{busybox} ip link set vcan0 up || say "no vcan0"
say "up"
cd {root} && {python} tests/proofs/socketcan/inside.py
say "exit $?"
{busybox} poweroff -f
"""


class Missing(Exception):  # noqa: N818 - not an error: a reason to skip
    """Something that this test needs and this machine cannot give."""


def packages() -> Path:
    """Return the folder of the unpacked kernel and busybox, fetched on first use."""
    unpacked = CACHE / "user-mode"
    if (unpacked / "complete").exists():
        return unpacked
    if shutil.which("apt-get") is None:
        raise Missing("there is no apt-get to fetch a kernel with")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        try:
            subprocess.run(["apt-get", "download", *PACKAGES], capture_output=True, check=True, cwd=folder)  # noqa: S607
        except (OSError, subprocess.CalledProcessError) as error:
            raise Missing(f"apt-get has no {' or '.join(PACKAGES)} for this machine (run apt-get update)") from error
        shutil.rmtree(unpacked, ignore_errors=True)
        unpacked.mkdir(parents=True)
        for package in Path(folder).glob("*.deb"):
            subprocess.run(["dpkg", "-x", str(package), str(unpacked)], check=True)  # noqa: S607
    (unpacked / "complete").touch()
    return unpacked


def compile_physics() -> None:
    """Compile the virtual bench here, once: the guest could not keep what it compiles."""
    subprocess.run([sys.executable, str(ROOT / "tests" / "proofs" / "socketcan" / "warm.py")], check=True, cwd=ROOT)


def script(unpacked: Path) -> str:
    """Return what the guest runs first; its end is the guest's."""
    (modules,) = unpacked.glob("usr/lib/uml/modules/*/kernel")
    return INIT.format(
        path=os.environ["PATH"],
        busybox=unpacked / "bin" / "busybox",
        modules=" ".join(str(modules / f"{name}.ko") for name in MODULES),
        root=ROOT,
        python=sys.executable,
    )


def boot(unpacked: Path) -> int:
    """Boot the guest, show what it says, and return the exit code of its job; TIMED_OUT if it did not end."""
    code = TIMED_OUT
    with tempfile.TemporaryDirectory() as folder:
        init = Path(folder) / "init"
        init.write_text(script(unpacked), encoding="utf-8")
        init.chmod(0o755)
        command = ["timeout", str(LONGEST_S), str(unpacked / "usr" / "bin" / "linux.uml"), *KERNEL, f"init={init}"]
        with subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        ) as guest:
            assert guest.stdout is not None
            for line in guest.stdout:
                text = line.decode(errors="replace").rstrip()
                ended = re.search(r"guest: exit (\d+)", text)
                code = int(ended[1]) if ended else code
                sys.stdout.write(f"{text}\n")
                sys.stdout.flush()
    return code


def main() -> int:
    """Test on SocketCAN, or say in one line why not."""
    try:
        unpacked = packages()
    except Missing as reason:
        sys.stdout.write(f"test-socketcan: SKIPPED, {reason}\n")
        return 0
    compile_physics()
    code = boot(unpacked)
    sys.stdout.write(f"test-socketcan: {'passed' if code == 0 else f'FAILED with {code}'}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
