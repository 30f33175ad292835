"""A batch written for other farms: valid where the format has a checker, and the same tasks in the same order."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.farm.manifest import Batch, plan_batch, read_batch
from unveil_core.farm.template import TEMPLATES, flamenco_job, openjd_template
from unveil_core.ground import blocks
from unveil_core.pipeline.settings import RunSettings


@pytest.fixture
def planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Batch:
    """A drive of three blocks and four frames."""
    monkeypatch.setattr(blocks, "BLOCK_M", 1.0)
    drive = make_tiny_drive(tmp_path / "drives" / "street")
    batch = plan_batch([drive], tmp_path / "batch", RunSettings(seed=4), ("--seed=4",))
    batch.save()
    return batch


def renamed(batch: Batch, *names: str) -> Batch:
    """The batch with its drive under several names."""
    (drive,) = batch.drives
    tasks = [
        replace(t, id=t.id.replace("street", n, 1), drive=n, after=tuple(a.replace("street", n, 1) for a in t.after))
        for n in names
        for t in batch.tasks
    ]
    return replace(batch, drives=tuple(replace(drive, name=n) for n in names), tasks=tuple(tasks))


def test_the_template_is_one_by_the_open_job_description(planned: Batch) -> None:
    model = pytest.importorskip("openjd.model")
    template = model.decode_job_template(template=json.loads(openjd_template(planned)))
    assert [step.name for step in template.steps][:3] == ["street.prepare", "street.reconstruct", "street.inpaint"]
    job = model.create_job(job_template=template, job_parameter_values={})
    assert len(model.StepParameterSpaceIterator(space=job.steps[1].parameterSpace)) == 3
    (memory,) = job.steps[1].hostRequirements.amounts
    assert (memory.name, memory.min) == ("amount.worker.memory", planned.drives[0].memory_mb)


def test_steps_of_long_names_that_differ_in_the_middle_are_two(planned: Batch) -> None:
    model = pytest.importorskip("openjd.model")
    names = [f"{'a' * 25}{middle}{'z' * 50}" for middle in ("1", "2")]
    steps = json.loads(openjd_template(renamed(planned, *names)))["steps"]
    assert len({step["name"] for step in steps}) == 10 and max(len(step["name"]) for step in steps) <= 64
    template = model.decode_job_template(
        template={"specificationVersion": "jobtemplate-2023-09", "name": "x", "steps": steps}
    )
    second = template.steps[6]
    assert [d.dependsOn for d in second.dependencies] == [template.steps[5].name]


def test_two_braces_in_a_path_are_refused_in_one_line(
    tmp_path: Path, planned: Batch, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_tiny_drive(tmp_path / "a{{b}}" / "drive")
    plan_batch([drive], planned.root, RunSettings(), replace=True).save()
    assert main(["batch", "template", str(planned.root), "--to", "openjd"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "a{{b}}" in line and "two braces" in line and "rename" in line
    assert not (planned.root / "batch.openjd.json").exists()
    for other in ("slurm", "flamenco"):
        assert main(["batch", "template", str(planned.root), "--to", other]) == 0


@pytest.mark.skipif(os.name == "nt", reason="names are bytes")
def test_a_drive_that_a_template_cannot_name_is_left_out_alone(
    tmp_path: Path, planned: Batch, capsys: pytest.CaptureFixture[str]
) -> None:
    bytes_of_old = Path(os.fsdecode(os.fsencode(tmp_path) + b"/stra\xdfe"))
    drives = [make_tiny_drive(tmp_path / name / "drive") for name in ("plain", "a{{b}}", "old")]
    (tmp_path / "old").rename(bytes_of_old)
    drives[2] = bytes_of_old / "drive/transforms.json"
    plan_batch(drives, planned.root, RunSettings(), replace=True).save()
    for name, missing in (("openjd", 2), ("slurm", 1), ("flamenco", 1)):
        capsys.readouterr()
        assert main(["batch", "template", str(planned.root), "--to", name]) == 1
        said = capsys.readouterr()
        lines = said.err.splitlines()
        assert len(lines) == missing and all(line.startswith("left out: ") for line in lines)
        assert "not UTF-8" in lines[-1] and "stra\\udcdfe" in lines[-1]
        text = (planned.root / TEMPLATES[name][0]).read_text(encoding="utf-8")
        assert "plain" in text or name == "flamenco" and "/transforms.json" in text
        assert "stra" not in text and ("{{b" in text) is (name != "openjd")
    plan_batch(drives[2:], planned.root, RunSettings(), replace=True).save()
    for name in TEMPLATES:
        assert main(["batch", "template", str(planned.root), "--to", name]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_templates_name_every_task_or_array(planned: Batch, capsys: pytest.CaptureFixture[str]) -> None:
    for name, (file, _) in TEMPLATES.items():
        assert main(["batch", "template", str(planned.root), "--to", name]) == 0
        text = (planned.root / file).read_text()
        assert "street.inpaint" in text and "run-block" in text
    script = (planned.root / "batch.slurm.sh").read_text()
    assert (
        f"--mem={planned.drives[0].memory_mb}M" in script
        and "--array=0-2" in script
        and script.count("sbatch ") == 5
        and "afterok:$job0" in script
    )
    assert shutil.which("sh") is None or os.system(f"sh -n {planned.root / 'batch.slurm.sh'}") == 0
    capsys.readouterr()


def test_templates_ask_for_the_gpu_that_a_manifest_says(planned: Batch) -> None:
    path = planned.root / "batch.json"
    texts = []
    for gpus in (0, 1):
        manifest = json.loads(path.read_text())
        assert [d["gpus"] for d in manifest["drives"]] == [0]  # that asks for none
        manifest["drives"][0]["gpus"] = gpus
        path.write_text(json.dumps(manifest))
        batch = read_batch(planned.root)
        texts.append(json.dumps(json.loads(openjd_template(batch))) + TEMPLATES["slurm"][1](batch))
    assert ["--gres=gpu:1" in t and '"amount.worker.gpu", "min": 1' in t for t in texts] == [False, True]


COMPILE = """
const made = [];
const author = {
    Task: (name, type) => ({ name, type, commands: [], before: [],
        addCommand(command) { this.commands.push(command); }, addDependency(task) { this.before.push(task.name); } }),
    Command: (name, parameters) => ({ name, ...parameters }),
};
const settings = Object.fromEntries(JOB_TYPE.settings.map((s) => [s.key, s.default]));
for (const given of [{}, { batch: "{shared}/batch", drives: "{shared}/drives" }]) {
    const tasks = [];
    compileJob({ settings: { ...settings, ...given }, addTask: (task) => tasks.push(task) });
    made.push(tasks);
}
console.log(JSON.stringify(made));
"""
"""Compiles a job as Flamenco's manager does: with the folders as they are, and as its two-way variables name them."""


def test_flamenco_gets_the_folders_as_settings(planned: Batch) -> None:
    text = flamenco_job(planned)
    tasks = json.loads(text.split("const TASKS = ")[1].split(";\n")[0])
    assert [t["id"] for t in tasks] == [t.id for t in planned.tasks]
    written = [a for t in tasks for a in t["arguments"]]
    assert ["batch", "/drives/street"] in written and ["drives", "/transforms.json"] in written
    assert not any(str(planned.root.parent) in a for a in written if isinstance(a, str))
    node = shutil.which("node")
    if node is None:
        return  # what follows is what the manager does with it
    ran = subprocess.run([node, "-"], input=text + COMPILE, capture_output=True, text=True, check=True)
    plain, by_variable = json.loads(ran.stdout)
    for task, made in zip(planned.tasks, plain, strict=True):
        assert made["commands"] == [{"name": "exec", "exe": "unveil", "args": list(task.arguments)}]
        assert made["name"] == task.id and made["before"] == list(task.after)
    assert by_variable[0]["commands"][0]["args"][:4] == [
        "run",
        "{shared}/drives/transforms.json",
        "-o",
        "{shared}/batch/drives/street",
    ]
