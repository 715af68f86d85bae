# Only what LEGATO uses: a compiled function keeps the types it is written with.
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

_F = TypeVar("_F", bound=Callable[..., Any])

class _Decorator(Protocol):
    def __call__(self, function: _F, /) -> _F: ...

def njit(
    *,
    cache: bool = ...,
    error_model: str = ...,
    forceinline: bool = ...,
    inline: str = ...,
    nogil: bool = ...,
    no_cpython_wrapper: bool = ...,
    no_cfunc_wrapper: bool = ...,
    _nrt: bool = ...,
) -> _Decorator: ...
