"""The command's grammar: every stage has its verb, every setting its option, and neither costs an import."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields

from unveil_core.app.given_settings import settings_of
from unveil_core.app.parser import BLOCK_STAGES, EXPORTS, STAGE_VERBS, command_parser
from unveil_core.app.verbs import VERBS
from unveil_core.exports.job import START_FRAME, TEXTURE_PX
from unveil_core.exports.registry import FORMATS
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.settings import RunSettings


def test_each_stage_has_a_verb_in_the_order_of_the_graph() -> None:
    assert ["import", *STAGE_VERBS] == [stage.name for stage in STAGES]
    assert list(BLOCK_STAGES) == [stage.name for stage in STAGES if stage.run_block is not None]


def test_each_format_of_export_is_named() -> None:
    assert list(EXPORTS) == list(FORMATS)
    given = command_parser().parse_args(["export", "ws"])
    assert (given.start_frame, given.texture) == (START_FRAME, TEXTURE_PX)


def test_each_verb_that_is_parsed_does_something() -> None:
    verbs = next(a for a in command_parser()._actions if a.dest == "verb")
    assert list(verbs.choices or ()) == list(VERBS)


def test_each_setting_has_an_option_and_what_is_not_given_stays_as_it_was() -> None:
    before = RunSettings(remove=("car",), seed=3, adapt=False, keyframes=("2",))
    assert settings_of(command_parser().parse_args(["inpaint", "ws"]), before) == before
    assert settings_of(command_parser().parse_args(["run", "drive", "-o", "ws"])) == RunSettings()
    verbs = next(a for a in command_parser()._actions if a.dest == "verb")
    for verb in ("run", "import", "check", "status", *STAGE_VERBS):
        options = {a.dest for a in verbs.choices[verb]._actions}  # type: ignore[index, call-overload]
        assert {f.name for f in fields(RunSettings)} <= options, verb


def test_the_grammar_loads_no_heavy_package() -> None:
    program = (
        "import sys, unveil_core.app.cli; "
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'torch', 'numpy', 'cv2', 'numba', 'scipy'}))"
    )
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
