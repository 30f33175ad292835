# SPDX-License-Identifier: GPL-3.0-or-later
"""One operator that calls another."""

from __future__ import annotations

from typing import Any

import bpy

__all__ = ["called"]


def called(operator: bpy.types.Operator, call: Any, *arguments: str, **words: Any) -> set[str]:
    """Call an operator: what it reports as an error, its caller gets as an exception, and reports it in turn.

    Args:
        operator: that calls; call: as ``bpy.ops.unveil.run``.
    Returns:
        what ``operator`` is to return.
    """
    try:
        begun = call(*arguments, **words)
    except RuntimeError as error:
        operator.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
        return {"CANCELLED"}
    return {"CANCELLED"} if "CANCELLED" in begun else {"FINISHED"}  # it may be asking something
