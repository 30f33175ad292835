"""GLBs as Khronos' validator sees them: it is a package of npm (gltf-validator), and asked where somebody has installed it."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from tests.exports.conftest import Street

VALIDATE = """
const { validateBytes } = require('gltf-validator'), fs = require('fs');
validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then(r => console.log(JSON.stringify(r.issues.messages)));
"""
UNKNOWN = "KHR_gaussian_splatting:"
"""Attributes of an extension that the validator does not know yet, and takes for wrong names."""


@pytest.mark.parametrize(("name", "file"), [("glb", ""), ("splat-gltf", ""), ("textured-glb", "empty.glb")])
def test_the_validator_finds_no_errors(name: str, file: str, street: Street) -> None:
    node = shutil.which("node")
    if node is None or subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True).returncode:
        pytest.skip("gltf-validator is not installed, or NODE_PATH does not lead to it")
    path = street.exported(name) / file if file else street.exported(name)
    done = subprocess.run([node, "-e", VALIDATE, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    errors = [m for m in json.loads(done.stdout) if m["severity"] == 0]
    assert [m for m in errors if UNKNOWN not in m["pointer"]] == []
