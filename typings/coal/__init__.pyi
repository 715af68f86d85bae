# Coal's names come from a compiled module without types: all of them are Any.
from typing import Any

def __getattr__(name: str) -> Any: ...
