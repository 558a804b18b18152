"""Which of the kinds of machine code that a package may bring is right for this processor."""

from __future__ import annotations

from typing import Any, cast

GENERIC = "generic"
X86_64_V3 = "x86-64-v3"
_FEATURES = {
    X86_64_V3: ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2", "xsave")
}
"""What a processor must have, in LLVM's words; the generic kind needs nothing."""


def kinds() -> list[tuple[str, str, str]]:
    """Return the kinds that run here, the best first, as numba names them: platform, processor, its features.

    Where ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES`` ask for one kind, it is that one alone.
    """
    import llvmlite.binding as llvm
    from numba.core import config as numba_config
    from numba.core.registry import cpu_target

    config = cast(Any, numba_config)
    if config.CPU_NAME or config.CPU_FEATURES:
        return [cpu_target.target_context.codegen().magic_tuple()]
    features = llvm.get_host_cpu_features()
    suits = [name for name, needed in _FEATURES.items() if all(features.get(one) for one in needed)]
    triple = llvm.get_process_triple()
    return [(triple, name, "") for name in (*suits, GENERIC)]
