"""Machine code from LLVM's intermediate language, cached on disk for this processor."""

from __future__ import annotations

import ctypes
import hashlib
import mmap
import pickle
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.files import cache_folder, write_whole
from trackbench.engine.vector_code import HEAD, WIDTH

#: Version of the generated code. Part of each cached file's name, so that no older file is found.
FORM = "11"
FUNCTION = "kernel"
#: Length of the checksum (SHA-256) of a cached file.
CHECKSUM_BYTES = 32
#: Optimisation level of LLVM: 1 gives the code of 2 in less time; the code of 0 is too slow.
EFFORT = 1
#: Option against LLVM's reordering: a kernel's order needs few registers, and compiles and runs in a fifth less time.
OPTION = "-enable-misched=false"


@cache
def unavailable() -> str | None:
    """Return why machine code cannot be made on this machine; None if it can."""
    try:
        import llvmlite.binding as llvm

        llvm.parse_assembly("declare void @takes(ptr)")
    except ModuleNotFoundError:
        return "llvmlite is not installed: pip install 'trackbench[fast]'"
    except (ImportError, OSError) as error:
        return f"llvmlite cannot be loaded: {error}"
    except (AttributeError, RuntimeError):
        return "this llvmlite is too old: pip install 'trackbench[fast]'"
    # Kernels read the address of an array's data from the array object, as every extension of NumPy does.
    probe = np.zeros(1)
    if ctypes.c_void_p.from_address(id(probe) + HEAD).value != probe.ctypes.data:
        return "the arrays of this NumPy have another form"
    return _no_executable_memory()


def _no_executable_memory() -> str | None:
    """Return why memory cannot be made executable, which would make LLVM end the process; None if it can."""
    try:
        page = mmap.mmap(-1, mmap.PAGESIZE)
        address = ctypes.addressof(ctypes.c_char.from_buffer(page))
        library = ctypes.CDLL(None, use_errno=True)
        library.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
        refused = library.mprotect(address, mmap.PAGESIZE, mmap.PROT_READ | mmap.PROT_EXEC)
        library.mprotect(address, mmap.PAGESIZE, mmap.PROT_READ | mmap.PROT_WRITE)
    except (OSError, AttributeError, TypeError, ValueError) as error:
        return f"it cannot be found out whether memory can be made executable ({error})"
    return "this machine lets no memory be made executable" if refused else None


@cache
def _set_option() -> None:
    # LLVM accepts an option only once.
    import llvmlite.binding as llvm

    llvm.set_option("trackbench", OPTION)


class Processor:
    """Target of machine code: this machine's processor, unless another is named.

    Args:
        name: LLVM's name, such as "x86-64-v3"; None for this machine's.
    """

    def __init__(self, name: str | None = None) -> None:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        _set_option()
        self._llvm: Any = llvm
        self._loaded: dict[str, MachineCode] = {}
        self.name = name or llvm.get_host_cpu_name()
        features = "" if name else llvm.get_host_cpu_features().flatten()
        self._target = llvm.Target.from_default_triple().create_target_machine(
            cpu=self.name, features=features, opt=EFFORT, jit=True, codemodel="jitdefault"
        )
        version = repr(llvm.llvm_version_info)
        parts = (FORM, version, self._target.triple, self.name, features, str(EFFORT), OPTION, str(WIDTH), str(HEAD))
        self.key = hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def object_code(self, text: str) -> bytes:
        """Compile a module's text; return its function's unique name, a line break, and the object file."""
        name = f"{FUNCTION}_{hashlib.sha256(text.encode()).hexdigest()}"
        module = self._llvm.parse_assembly(text.replace(f"@{FUNCTION}", f"@{name}"))
        module.verify()
        return name.encode() + b"\n" + bytes(self._target.emit_object(module))

    def function(self, code: bytes, arrays: int) -> MachineCode:
        """Load the function in the result of ``object_code``, which takes two numbers and ``arrays`` arrays."""
        head, _, file = code.partition(b"\n")
        name = head.decode()
        if name not in self._loaded:
            self._engine.add_object_file(self._llvm.ObjectFileRef.from_data(file))
            self._engine.finalize_object()
            whole, part = (self._engine.get_function_address(name + end) for end in ("", ".part"))
            self._loaded[name] = MachineCode(self._engine, whole, arrays, part)
        return self._loaded[name]

    @cached_property
    def _engine(self) -> Any:
        # The LLVM engine owns its target, so that it needs one for itself.
        target = self._llvm.Target.from_default_triple().create_target_machine(jit=True, codemodel="jitdefault")
        return self._llvm.create_mcjit_compiler(self._llvm.parse_assembly(""), target)


class MachineCode:
    """Machine code in memory; ``call`` takes two numbers, and arrays by their ``id``.

    ``part`` is the address of the kernel's second function, which computes a range of members.
    """

    def __init__(self, engine: Any, address: int, arrays: int, part: int) -> None:
        # The engine owns the code.
        self._engine = engine
        self.part = part
        self.call = ctypes.CFUNCTYPE(*[ctypes.c_int64] * 3, *[ctypes.c_void_p] * arrays)(address)


class KernelCache:
    """Kernels on disk, each under a key: the source from which it was made.

    Each file begins with a checksum of its key and content; a damaged file, or one with another key, counts as missing.
    Where nothing can be written, nothing is cached.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or cache_folder() / "kernels"

    def find(self, key: str) -> Any:
        """Return the value stored under a key; None if there is none."""
        try:
            data = self._place(key).read_bytes()
        except OSError:
            return None
        packed = data[CHECKSUM_BYTES:]
        return pickle.loads(packed) if data[:CHECKSUM_BYTES] == _checksum(key, packed) else None

    def put(self, key: str, value: Any) -> None:
        """Store a value under a key, if the disk can be written."""
        packed = pickle.dumps(value)
        with suppress(OSError):
            write_whole(self._place(key), _checksum(key, packed) + packed)

    def _place(self, key: str) -> Path:
        return self._folder / f"{key}.o"


def _checksum(key: str, packed: bytes) -> bytes:
    return hashlib.sha256(key.encode() + packed).digest()
