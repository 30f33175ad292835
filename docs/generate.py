"""Writes the parts of the pages that follow from the code and from what was measured: drawings and tables.

    python docs/generate.py

A generated part lies between ``<!-- generated: NAME ... -->`` and ``<!-- end -->``. ``tests/test_architecture.py`` makes the
parts anew, compares, and holds the imports to :data:`ORDER`. Tables of measurements are in docs/tables/.
"""

from __future__ import annotations

import ast
import json
import re
import sys
from dataclasses import dataclass
from functools import cache
from importlib.util import resolve_name
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from docs.tables import real, robust, runs, scenes, streets  # noqa: E402
from docs.tables.read import dated  # noqa: E402

PACKAGE = "unveil_core"
COMMAND = "python docs/generate.py"

ORDER = {
    "api": "Python's face",
    "app": "the unveil command",
    "bench": "measurements",
    "farm": "many drives, many machines",
    "checkup": "a drive before the wait",
    "marking": "clicks become objects",
    "solve": "cameras from footage",
    "pipeline": "stages, runner, settings",
    "forecast": "time, memory, disk to come",
    "report": "the page, videos",
    "exports": "files of other programs",
    "evaluate": "metrics, baselines",
    "provenance": "origins, certainty",
    "workspace": "files, lock, journal",
    "mesh": "fusion, export",
    "corrections": "what was mended by hand",
    "delivery": "frames at the footage's size",
    "inpaint": "ground, light, facades, frames",
    "remove": "selection, visibility",
    "movers": "dynamic objects",
    "view": "the scene as a frame sees it",
    "optimize": "reconstruct, re-optimize",
    "labelling": "labels by boxes, networks",
    "points": "points from pictures",
    "ground": "path, ground, terrain",
    "semantics": "classes, votes, objects",
    "raster": "the rasterizer",
    "surfels": "the scene, the sky",
    "drives": "readers, import",
    "geometry": "cameras, axes, images",
    "base": "files, errors, threads",
}
"""The packages of unveil_core from top to bottom, and a word on each. A package imports only from those below it."""


@dataclass(frozen=True)
class Import:
    """One import statement's target: ``module`` imports ``target``, or the name ``name`` out of it, at ``line``."""

    module: str
    target: str
    name: str
    line: int


def package_of(module: str) -> str:
    """``inpaint`` of ``unveil_core.inpaint.light.sun``; empty for the package ``unveil_core`` itself."""
    return module.partition(".")[2].partition(".")[0]


@cache
def modules() -> dict[str, Path]:
    """All modules of unveil_core, by dotted name."""
    found = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports() -> tuple[Import, ...]:
    """All imports of all modules, also those inside functions and under ``TYPE_CHECKING``."""
    known, found = modules(), []
    for module, path in known.items():
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found += [Import(module, alias.name, "", node.lineno) for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                source = resolve_name("." * node.level + (node.module or ""), package)
                for alias in node.names:
                    whole = f"{source}.{alias.name}" in known
                    target, name = (f"{source}.{alias.name}", "") if whole else (source, alias.name)
                    found.append(Import(module, target, name, node.lineno))
    return tuple(found)


@cache
def package_imports() -> dict[str, frozenset[str]]:
    """For each package, the other packages that it imports from."""
    found: dict[str, set[str]] = {name: set() for name in ORDER}
    for entry in imports():
        source, target = package_of(entry.module), package_of(entry.target)
        if entry.target.startswith(f"{PACKAGE}.") and source in found and source != target:
            found[source].add(target)
    return {name: frozenset(targets) for name, targets in found.items()}


def below(package: str) -> set[str]:
    """All packages that one can be reached from by imports, over any number of steps."""
    found: set[str] = set()
    waiting = [package]
    while waiting:
        new = package_imports().get(waiting.pop(), frozenset()) - found
        found |= new
        waiting += new
    return found


def drawing() -> str:
    """The packages as a Mermaid flowchart. An arrow that follows from two others is not drawn."""
    lines = ["```mermaid", "flowchart TD"]
    lines += [f'    {name}["{name}<br/>{what}"]' for name, what in ORDER.items()]
    for name in ORDER:
        targets = package_imports()[name]
        lines += [
            f"    {name} --> {target}"
            for target in ORDER
            if target in targets and not any(target in below(other) for other in targets - {target})
        ]
    return "\n".join([*lines, "```"])


def package_table() -> str:
    """What each package holds, in the words of its docstring, and all packages that it imports from."""
    lines = ["| package | holds | imports from |", "|---|---|---|"]
    for name in ORDER:
        text = ast.get_docstring(ast.parse((ROOT / PACKAGE / name / "__init__.py").read_text(encoding="utf-8"))) or ""
        first = re.sub(r":\w+:(?=`)", "", " ".join(text.split("\n\n")[0].split())).replace("``", "`")
        targets = " ".join(f"`{target}`" for target in ORDER if target in package_imports()[name])
        lines.append(f"| `{name}` | {first} | {targets or '–'} |")
    return "\n".join(lines)


def stage_table() -> str:
    """What each stage declares: its inputs, its outputs, and the settings that matter to it."""
    from unveil_core.pipeline.graph import STAGES

    def shown(names: tuple[str, ...]) -> list[str]:
        return [f"`{name}{'' if Path(name).suffix else '/'}`" for name in names]

    lines = ["| stage | reads | writes | settings |", "|---|---|---|---|"]
    for stage in STAGES:
        outside = [] if stage.outside is None else [f"*{stage.outside.__name__.replace('_', ' ')}*"]
        reads = [*outside, *shown(stage.inputs)]
        settings = [f"`{name}`" for name in stage.settings]
        cells = (reads, shown(stage.outputs), settings)
        lines.append(f"| `{stage.name}` | " + " | ".join(" ".join(cell) or "–" for cell in cells) + " |")
    return "\n".join(lines)


def export_table() -> str:
    """Each format of ``unveil export``: what it holds, by which library, what reads it back, and what is lost."""
    from unveil_core.exports.registry import EXTRA, FORMATS

    lines = ["| format | holds | written as | library | read back by | lost |", "|---|---|---|---|---|---|"]
    for f in FORMATS.values():
        library = f.library or "own code"
        extra = f" (`{EXTRA}`)" if f.modules else ""
        result = f"`{f.result.replace('{state}', 'STATE')}{'' if f.suffix else '/'}`"
        lines.append(f"| `{f.name}` | {f.what} | {result} | {library}{extra} | {f.read_back} | {f.lost} |")
    return "\n".join(lines)


def settings_table() -> str:
    """The settings of runs and stages, a table for each group."""
    from unveil_core.pipeline.options.table import GROUPS, TABLE

    parts = []
    for group, title in GROUPS.items():
        lines = [
            f"**{title[0].upper()}{title[1:]}**",
            "",
            "| option | Python | meaning | default |",
            "|---|---|---|---|",
        ]
        for s in (s for s in TABLE if s.group == group):
            value = s.metavar or "|".join(s.kind.names)
            option = f"{s.option} {value}".strip() if s.kind.shape != "flag" else f"{s.option}`, `--no-{s.option[2:]}"
            names = f": {', '.join(f'`{n}`' for n in s.kind.names)}" if s.metavar and s.kind.names else ""
            see = f"; see [{s.see.partition('#')[0]}]({s.see.removeprefix('command.md')})" if s.see else ""
            default = s.usual or f"`{s.said_default}`"
            star = " ★" if s.expert else ""
            cells = (f"`{option}`", f"`{s.name}`", f"{s.help}{names}{see}{star}", default)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def recorded_settings() -> str:
    """What workspace.json has of each setting at its default, and the stages that it makes anew."""
    from unveil_core.pipeline.graph import STAGES
    from unveil_core.pipeline.options.table import TABLE
    from unveil_core.pipeline.settings import RunSettings

    usual = RunSettings().to_json()
    lines = ["| setting | type | default | matters to |", "|---|---|---|---|"]
    for s in TABLE:
        stages = " ".join(f"`{stage.name}`" for stage in STAGES if s.name in stage.settings) or "no result"
        kind = s.type.replace("|", "\\|")
        lines.append(f"| `{s.name}` | `{kind}` | `{json.dumps(usual[s.name])}` | {stages} |")
    return "\n".join(lines)


def mechanism_table() -> str:
    """What a run can do without, by stage."""
    from unveil_core.pipeline.mechanisms import MECHANISMS

    rows = [f"| `{m.name}` | `{m.stage}` | {m.says} |" for m in MECHANISMS.values()]
    return "\n".join(["| mechanism | stage | what it does |", "|---|---|---|", *rows])


def addon_settings() -> str:
    """The table that the add-on reads."""
    from unveil_core.pipeline.options.for_addon import table_as_json

    return table_as_json()


FILES = {"blender_addon/formats/table/settings.json": addon_settings}
"""Generated files, from the root of the repository."""
PARTS = {
    "../README.md": {"shots": runs.shots, "install": robust.install},
    "benchmarks.md": {
        "whole runs": runs.whole_runs,
        "cost of whole runs": runs.cost,
        "methods": runs.methods,
        "presets": runs.presets,
        "hard streets": runs.hard_streets,
        "first looks": streets.first_looks,
        "ranges": streets.ranges,
        "path ahead": streets.ahead,
        "special cases": streets.special_cases,
        "without lidar": streets.without_lidar,
        "clicks": real.clicks,
        "solved": real.solved,
        "beside lidar": real.beside_lidar,
        "points": real.points,
        "real drives": real.real,
        "real drives compared": real.real_against,
        "chart holes": real.chart_holes,
        "certainty": streets.certainty,
    },
    "benchmarks_parts.md": {
        "reconstruction": scenes.reconstruction,
        "ablations": scenes.ablations,
        "rasterizer": scenes.rasterizer,
        "card passes": scenes.card_passes,
        "card runs": scenes.card_runs,
        "torch step": scenes.torch_step,
        "gpu share": scenes.gpu_share,
        "long drives": robust.long_drives,
        "long stages": robust.long_stages,
        "threads": robust.threads,
        "stage costs": robust.stage_costs,
        "whole runs": robust.whole_runs,
        "batch": robust.batch,
        "import memory": robust.import_memory,
        "mesh fusion": robust.mesh_fusion,
        "textures": scenes.textures,
        "kills": robust.kills,
        "faults": robust.faults,
        "formats": robust.formats,
        "fuzzing": robust.fuzzing,
        "blender": robust.blender,
    },
    "command.md": {"settings": settings_table, "mechanisms": mechanism_table},
    "development.md": {"packages": drawing, "package table": package_table},
    "exports.md": {"formats": export_table},
    "workspace.md": {"stages": stage_table, "settings": recorded_settings},
}
"""The generated parts by page, from docs/, and name."""


def generated(page: str) -> str:
    """The text of a page with its generated parts made anew.

    Raises:
        ValueError: a part's markers are missing.
    """
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    for name, make in PARTS[page].items():
        begin = f"<!-- generated: {name} ({COMMAND}) -->"
        before, found, rest = text.partition(begin)
        _, ended, after = rest.partition("<!-- end -->")
        if not found or not ended:
            raise ValueError(f"docs/{page} has no {begin} with <!-- end --> after it")
        text = f"{before}{begin}\n\n{dated(make)}\n\n<!-- end -->{after}"
    return text


def main() -> None:
    """Write all pages and files."""
    for name, make in FILES.items():
        (ROOT / name).write_text(make(), encoding="utf-8")
    for page in PARTS:
        (ROOT / "docs" / page).write_text(generated(page), encoding="utf-8")


if __name__ == "__main__":
    main()
