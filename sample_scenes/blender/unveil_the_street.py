"""The sample street emptied of two cars, by operators only: blender --background --python THIS -- OUT.blend [WORKSPACE]

Operators called from a script block until their job has ended, and raise RuntimeError with one line where it failed.
"""

import sys
from pathlib import Path

import bpy

given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
out = Path(given[0] if given else "unveiled_street.blend").absolute()
workspace = Path(given[1]).absolute() if len(given) > 1 else out.with_suffix("")
drive = Path(__file__).resolve().parent.parent / "parked_street" / "transforms.json"

bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.unveil.check_python()
bpy.context.scene.unveil.quality = "draft"
bpy.ops.unveil.import_drive(filepath=str(drive), workspace=str(workspace))

# Two cars go: those seen in most frames. Everything else stays.
objects = bpy.context.scene.unveil_selection.objects
cars = sorted((o for o in objects if o.class_name == "car"), key=lambda o: -o.frames)[:2]
for thing in objects:
    thing.chosen = thing in cars

bpy.ops.unveil.run()
bpy.ops.wm.save_as_mainfile(filepath=str(out))
print(f"{out}: {', '.join(o.name for o in cars)} gone; workspace {workspace}")
