"""Numbers as JSON: whatever is not a number becomes null, everything else reads back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(results: Mapping[str, Any]) -> str:
    """Write numbers, arrays and words by name as JSON text; NaN and infinity become null."""
    return json.dumps(_plain(results), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
