"""`make test-socketcan`: boots Debian's kernel under qemu, where there is a real SocketCAN bus, and tests on it.

The guest sees this machine's files below a throw-away overlay, so nothing has to be installed in it. It is emulated
and slow: no figure of time from inside means anything. Where qemu or the packages cannot be had, one line says so and
the exit code is 0. The kernel and busybox come from Debian's archive by `apt-get download` and are kept in the cache.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from initramfs import initramfs

ROOT = Path(__file__).parents[2]
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "lostmotion-socketcan"
MACHINE = "qemu-system-x86_64"
LONGEST_S = int(os.environ.get("SOCKETCAN_SECONDS", "580"))
KVM_BOOT_S = 20
"""A guest on a processor that works is up in 3 s; one inside another virtual machine may stand still for ever."""

NOT_UP = 126
JOB = """cd {root} || exit 99
export PATH={path} HOME=/tmp PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1 NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES=
export NUMBA_CACHE_DIR={numba}
exec {python} tests/socketcan/inside.py
"""


class Missing(Exception):  # noqa: N818 - not an error: a reason to skip
    """Something that this test needs and this machine cannot give."""


def _run(*command: str, cwd: Path | None = None) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=cwd)
    except (OSError, subprocess.CalledProcessError) as error:
        raise Missing(f"'{' '.join(command)}' failed") from error
    return done.stdout


def packages() -> Path:
    """Return the folder of the unpacked kernel and busybox, fetched on first use."""
    if shutil.which(MACHINE) is None:
        raise Missing(f"{MACHINE} is not installed (Debian: apt-get install qemu-system-x86)")
    unpacked = CACHE / "unpacked"
    if (unpacked / "complete").exists():
        return unpacked
    if shutil.which("apt-get") is None:
        raise Missing("there is no apt-get to fetch a kernel with")
    kernels = re.findall(r"Depends: (linux-image-\d\S+)", _run("apt-cache", "depends", "linux-image-amd64"))
    if not kernels:
        raise Missing("apt knows no kernel (run apt-get update)")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        _run("apt-get", "download", kernels[0], "busybox-static", cwd=Path(folder))
        shutil.rmtree(unpacked, ignore_errors=True)
        unpacked.mkdir(parents=True)
        for package in Path(folder).glob("*.deb"):
            _run("dpkg", "-x", str(package), str(unpacked))
    (unpacked / "complete").touch()
    return unpacked


def compile_physics() -> Path:
    """Compile the virtual bench for a plain processor here: in the guest it would take minutes. Return the cache."""
    cache = CACHE / "numba"
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, str(ROOT / "tests" / "socketcan" / "warm.py")]
    subprocess.run(command, check=True, cwd=ROOT, env=os.environ | plain)
    return cache


def accelerators() -> list[str]:
    """Return what to try, best first: the processor itself where the kernel lends it, else emulation."""
    lent = os.access("/dev/kvm", os.R_OK | os.W_OK)
    return [*(["kvm"] if lent else []), "tcg,thread=multi"]


def boot(unpacked: Path, job: str, accelerator: str, boot_s: float) -> int:
    """Boot the guest, show what it says, and return the exit code of its job.

    125: its job did not end within the time. 126: it was not up within `boot_s`, as in a guest of a guest.
    """
    kernel = next(iter(sorted(unpacked.glob("boot/vmlinuz-*"))))
    code = NOT_UP
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder) / "initramfs"
        first.write_bytes(initramfs(unpacked, job))
        share = "local,path=/,mount_tag=project,security_model=none,readonly=on,multidevs=remap"
        command = [
            *("timeout", str(LONGEST_S), MACHINE, "-nodefaults", "-no-reboot", "-nographic", "-serial", "stdio"),
            *("-accel", accelerator, "-cpu", "max,arch-capabilities=off", "-smp", "2", "-m", "3072"),
            *("-kernel", str(kernel), "-initrd", str(first), "-append", "console=ttyS0 quiet panic=-1 rdinit=/init"),
            *("-virtfs", share),
        ]
        with subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        ) as guest:
            assert guest.stdout is not None
            too_late = threading.Timer(boot_s, guest.terminate)
            too_late.start()
            for line in guest.stdout:
                text = line.decode(errors="replace").rstrip()
                ended = re.search(r"guest: exit (\d+)", text)
                if "guest: up" in text:
                    too_late.cancel()
                    code = 125
                elif ended:
                    code = int(ended[1])
                sys.stdout.write(f"{text}\n")
                sys.stdout.flush()
            too_late.cancel()
    return code


def main() -> int:
    """Test on SocketCAN, or say in one line why not."""
    try:
        unpacked = packages()
    except Missing as reason:
        sys.stdout.write(f"test-socketcan: SKIPPED, {reason}\n")
        return 0
    job = JOB.format(root=ROOT, path=os.environ["PATH"], python=sys.executable, numba=compile_physics())
    for accelerator in accelerators():
        limit_s = KVM_BOOT_S if accelerator == "kvm" else LONGEST_S
        code = boot(unpacked, job, accelerator, limit_s)
        if code != NOT_UP:
            break
        sys.stdout.write(f"test-socketcan: the guest did not come up with {accelerator}\n")
    sys.stdout.write(f"test-socketcan: {'passed' if code == 0 else f'FAILED with {code}'}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
