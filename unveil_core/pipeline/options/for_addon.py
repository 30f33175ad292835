"""The table of settings as a file for the add-on, which imports nothing of this package; ``python docs/generate.py`` writes it."""

from __future__ import annotations

import json

from unveil_core.pipeline.mechanisms import MECHANISMS
from unveil_core.pipeline.options.table import GROUPS, TABLE, Setting

__all__ = ["table_as_json"]


def table_as_json() -> str:
    """A list of objects, one for each setting, in the order in which they are shown; and the stage of each mechanism."""
    rows = ",\n".join(f"  {json.dumps(_row(setting))}" for setting in TABLE)
    stages = json.dumps({m.name: m.stage for m in MECHANISMS.values()})
    return f'{{\n "groups": {json.dumps(GROUPS)},\n "mechanisms": {stages},\n "settings": [\n{rows}\n ]\n}}\n'


def _row(setting: Setting) -> dict[str, object]:
    choices = setting.choices or tuple((name, name, "") for name in setting.kind.names)
    default = list(setting.default) if isinstance(setting.default, tuple) else setting.default
    return {
        "name": setting.name,
        "option": setting.option,
        "label": setting.label,
        "shape": setting.kind.shape,
        "items": "int" if "int" in setting.type else "str",
        "default": default,
        "usual": setting.usual,
        "help": setting.help[0].upper() + setting.help[1:],
        "group": setting.group,
        "measure": setting.measure,
        "expert": setting.expert,
        "choices": [list(choice) for choice in choices],
        "low": setting.low,
        "high": setting.high,
    }
