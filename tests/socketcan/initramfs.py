"""A Linux guest's first file system, made without tools: kernel modules, a static busybox, and an init script."""

from __future__ import annotations

from pathlib import Path

MODULES = (
    "virtio", "virtio_ring", "virtio_pci_legacy_dev", "virtio_pci_modern_dev", "virtio_pci",
    "fscache", "netfs", "9pnet", "9pnet_virtio", "9p", "overlay", "can", "can-raw", "can-dev", "vcan",
)  # fmt: skip
"""Roughly in the order in which they depend on each other: PCI devices, the shared root, the overlay, the CAN bus."""

INIT = """#!/bin/busybox sh
say() { /bin/busybox echo "guest: $*"; }
for name in proc sys dev root top; do /bin/busybox mkdir -p /$name; done
/bin/busybox mount -t proc none /proc
/bin/busybox mount -t sysfs none /sys
/bin/busybox mount -t devtmpfs none /dev
# Twice: which of a pair needs the other differs between kernels.
for module in $(/bin/busybox cat /modules/order /modules/order); do
  /bin/busybox insmod /modules/$module.ko 2>/dev/null
done
/bin/busybox mount -t tmpfs none /top
/bin/busybox mkdir /top/changes /top/work /top/host
/bin/busybox mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=524288,cache=loose project /top/host || say "no root"
/bin/busybox mount -t overlay -o lowerdir=/top/host,upperdir=/top/changes,workdir=/top/work none /root
for name in proc sys dev; do /bin/busybox mount --move /$name /root/$name; done
/bin/busybox mkdir -p /root/dev/shm /root/dev/pts
/bin/busybox mount -t tmpfs none /root/dev/shm
/bin/busybox mount -t devpts none /root/dev/pts
/bin/busybox ip link set lo up
/bin/busybox ip link add dev vcan0 type vcan
/bin/busybox ip link set vcan0 up || say "no vcan0"
say "up"
/bin/busybox cp /job /root/tmp/socketcan-job
/bin/busybox chroot /root /bin/sh /tmp/socketcan-job
say "exit $?"
/bin/busybox poweroff -f
"""


def _entry(name: str, mode: int, content: bytes, number: int) -> bytes:
    """Return one file in the kernel's `newc` archive format."""
    encoded = name.encode() + b"\0"
    fields = (number, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(encoded), 0)
    head = b"070701" + b"".join(f"{field:08x}".encode() for field in fields) + encoded
    head += b"\0" * (-len(head) % 4)
    return head + content + b"\0" * (-len(content) % 4)


def archive(files: dict[str, bytes], folders: tuple[str, ...]) -> bytes:
    """Return an archive of executable files and the folders that they lie in."""
    entries = [_entry(folder, 0o040755, b"", number) for number, folder in enumerate(folders, 1)]
    entries += [_entry(name, 0o100755, content, 1000 + number) for number, (name, content) in enumerate(files.items())]
    return b"".join(entries) + _entry("TRAILER!!!", 0, b"", 0)


def initramfs(packages: Path, job: str) -> bytes:
    """Return the guest's first file system, from unpacked Debian packages and a shell script to run.

    Raises FileNotFoundError when the packages lack busybox.
    """
    found = {path.stem: path for path in packages.glob("lib/modules/**/*.ko")}
    there = [name for name in MODULES if name in found]
    files = {f"modules/{name}.ko": found[name].read_bytes() for name in there}
    files["modules/order"] = (" ".join(there) + "\n").encode()
    files["bin/busybox"] = (packages / "bin" / "busybox").read_bytes()
    files["job"] = job.encode()
    files["init"] = INIT.encode()
    return archive(files, ("bin", "modules"))
