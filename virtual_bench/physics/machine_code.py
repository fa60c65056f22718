"""The compiled inner step of the plant, as a function to call: compiled by numba once, loaded without it ever after.

numba takes two seconds to be imported and to find its own cached code again, in each of the many processes that hold
a virtual bench; what it makes of the kernel is 20 KB of machine code that needs nothing else. So that code is kept
as an object file beside the compiled Python modules, under a name made of all that it depends on, and LLVM alone loads
it in a hundredth of that time.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

Look = Callable[[int, int, int, int, int, int], None]
"""`plant_kernel.look` by addresses: numbers, their count, noise, steps, counts, values."""

SOURCES = ("plant_kernel.py", "plant_numbers.py", "decay.py")
"""What the kernel is made of; it is compiled anew when one of these files changes."""

NAME = "look"
"""Its name in the object file."""

DIGEST_BYTES = hashlib.sha256().digest_size
"""An object file begins with the SHA-256 of what follows: half a file, loaded, would end the process."""

ROUNDS = 2
"""Rounds of the optimiser: the first one puts all into one function, the second then finds what can never happen
there, and with it the last calls of numba's own library."""

_kept_alive: list[Any] = []
"""The engines that own the loaded code."""


@cache
def look() -> Look:
    """Return the compiled kernel; compiling it takes some seconds, once for each computer and version."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    name = f"plant-{_fingerprint(cpu, features)}.o"
    for folder in _folders():
        code = _read(folder / name)
        if code is not None:
            return _loaded(code)
    code = _compiled(cpu, features)
    for folder in _folders():
        if _keep(folder / name, code):
            break
    return _loaded(code)


def _fingerprint(cpu: str, features: str) -> str:
    """Return a hash of all that the machine code depends on."""
    here = Path(__file__).parent
    parts = [llvmlite.__version__, sys.platform, cpu, features, Path(__file__).read_text("utf-8")]
    parts += [(here / source).read_text("utf-8") for source in SOURCES]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


def _folders() -> Iterator[Path]:
    """Yield where the code may be kept: beside the compiled modules, or in a cache of the user's own."""
    yield Path(__file__).parent / "__pycache__"
    with contextlib.suppress(RuntimeError):  # a user without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lostmotion"


def _read(file: Path) -> bytes | None:
    """Return the code that a file keeps; None where there is none, or only a part of it, or somebody else's."""
    try:
        if file.stat().st_uid not in (os.getuid(), Path(__file__).stat().st_uid):
            return None
        kept = file.read_bytes()
    except OSError:
        return None
    digest, code = kept[:DIGEST_BYTES], kept[DIGEST_BYTES:]
    return code if digest == hashlib.sha256(code).digest() else None


def _keep(file: Path, code: bytes) -> bool:
    """Keep the code for later starts and return whether that was possible; others see all of it or nothing."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as new:
            new.write(hashlib.sha256(code).digest() + code)
        Path(new.name).replace(file)
    except OSError:
        return False
    return True


def _compiled(cpu: str, features: str) -> bytes:
    """Compile the kernel, and return it as an object file that needs no Python."""
    from virtual_bench.physics import plant_kernel  # noqa: PLC0415 - brings numba

    module = llvm.parse_assembly(plant_kernel.look.inspect_llvm())
    module.get_function(plant_kernel.look.native_name).name = NAME
    for one in (*module.functions, *module.global_variables):
        if not one.is_declaration and one.name != NAME:
            one.linkage = "internal"  # what nobody calls then goes, numba's wrappers for Python first
    machine = _machine(cpu, features)
    for _ in range(ROUNDS):
        passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
        passes.getModulePassManager().run(module, passes)
    called = {one.name for one in module.functions if one.is_declaration and not one.name.startswith("llvm.")}
    if called:
        names = ", ".join(sorted(called))
        raise RuntimeError(
            f"plant_kernel.py: the compiled kernel calls {names}; without numba it may call only functions of LLVM "
            "itself. Change the kernel so that it neither raises nor allocates"
        )
    return bytes(machine.emit_object(module))


def _machine(cpu: str, features: str) -> Any:
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=3, jit=True)


def _loaded(code: bytes) -> Look:
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine("", ""))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _kept_alive.append(engine)
    whole, address = ctypes.c_int64, ctypes.c_void_p
    kind = ctypes.PYFUNCTYPE(None, address, whole, address, whole, address, address)
    return kind(engine.get_function_address(NAME))
