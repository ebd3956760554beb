"""How the reference reads docstrings: an example is shown as code."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension


class Examples(Extension):
    """Take the section ``Example`` for what Google's style calls ``Examples``."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        """Rename the heading in the docstring of an object."""
        if obj.docstring is not None:
            obj.docstring.value = re.sub(
                r"^(\s*)Example:$", r"\1Examples:", obj.docstring.value, flags=re.MULTILINE
            )
