"""Three examples of each verb, which its help ends with."""

from __future__ import annotations

__all__ = ["EXAMPLES"]

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": (
        "unveil demo",
        "unveil demo --quality draft -o first_look",
        "unveil demo --remove car --shadows off",
    ),
    "run": (
        "unveil run street -o street_empty --quality draft",
        "unveil run street -o street_empty --remove vehicle --instances 3,7",
        "unveil run street -o street_empty --quality high --dry-run",
    ),
    "import": (
        "unveil import street -o street_empty --preview",
        "unveil import kitti/training -o street_empty --scene 0005 --cameras all",
        "unveil import street -o street_empty --camera-height 1.4",
    ),
    "check": (
        "unveil check street",
        "unveil check street -o look.html --scale 0.31",
        "unveil check street --pose-convention opencv --json",
    ),
    "mask": (
        "unveil mask street -o outlined --click 12:640,410 --click 12:700,430",
        "unveil mask street_empty -o outlined --object van --click 3:200,310 --not 3:200,180",
        "unveil mask street -o outlined --moving",
    ),
    "solve": (
        "unveil solve clip.mp4 -o street",
        "unveil solve photographs/ -o street --labels labels/ --camera-height 1.4",
        "unveil solve clip.mov -o street --focal 26mm --every 2",
    ),
    "status": (
        "unveil status street_empty",
        "unveil status street_empty --quality high",
        "unveil status street_empty --json",
    ),
    "objects": (
        "unveil objects street_empty",
        "unveil objects street_empty --marked marked.json",
        "unveil objects street_empty --marked none",
    ),
    "segment": (
        "unveil segment street_empty",
        "unveil segment street_empty --movers keep",
        "unveil segment street_empty --movers auto --json",
    ),
    "choose": (
        "unveil choose street_empty --remove car,truck",
        "unveil choose street_empty --remove auto --instances 3,7",
        "unveil choose street_empty --remove human",
    ),
    "reconstruct": (
        "unveil reconstruct street_empty",
        "unveil reconstruct street_empty --quality high --device cuda",
        "unveil reconstruct street_empty --iterations 3000 --splats 200000",
    ),
    "ground": (
        "unveil ground street_empty",
        "unveil ground street_empty --json",
        "unveil ground street_empty -v",
    ),
    "instances": (
        "unveil instances street_empty",
        "unveil instances street_empty --marked marked.json",
        "unveil instances street_empty --json",
    ),
    "remove": (
        "unveil remove street_empty",
        "unveil remove street_empty --per-object 3:grow=8",
        "unveil remove street_empty --per-object 3:grow=8,7:shadow=keep",
    ),
    "inpaint": (
        "unveil inpaint street_empty",
        "unveil inpaint street_empty --shadows 135,40",
        "unveil inpaint street_empty --inpainter lama.onnx",
    ),
    "reoptimize": (
        "unveil reoptimize street_empty",
        "unveil reoptimize street_empty --corrections corrections.json",
        "unveil reoptimize street_empty --device cuda",
    ),
    "deliver": (
        "unveil deliver street_empty",
        "unveil deliver street_empty --corrections corrections.json",
        "unveil deliver street_empty -q",
    ),
    "mesh": (
        "unveil mesh street_empty",
        "unveil mesh street_empty --quality high",
        "unveil mesh street_empty --json",
    ),
    "report": (
        "unveil report street_empty",
        "unveil report street_empty --baselines",
        "unveil report street_empty --no-baselines",
    ),
    "run-block": (
        "unveil run-block street_empty reconstruct 0",
        "unveil run-block street_empty reconstruct 3 --json",
        "unveil run-block street_empty reoptimize 1",
    ),
    "evaluate": (
        "unveil evaluate street_empty",
        "unveil evaluate street_empty --truth empty_street",
        "unveil evaluate street --holdout-masks --quality draft -o street_measured",
    ),
    "render": (
        "unveil render street_empty -o views",
        "unveil render street_empty --beside -1.5 --above 0.5 -o views",
        "unveil render street_empty --path path.json --planes rgb,depth -o views",
    ),
    "export": (
        "unveil export street_empty -o street.glb",
        "unveil export street_empty --to splat-ply,colmap -o out",
        "unveil export street_empty --to png,mattes --start-frame 1 -o plates",
    ),
    "bench": (
        "unveil bench raster --quick",
        "unveil bench step --device cpu -o step.json",
        "unveil bench run street --quality draft -o runs.json",
    ),
    "batch plan": (
        "unveil batch plan drives/one drives/two -o batch",
        "unveil batch plan drives/one -o batch --quality high --remove vehicle",
        "unveil batch plan drives/one -o batch --device cuda",
    ),
    "batch run": (
        "unveil batch run batch",
        "unveil batch run batch --workers 4",
        "unveil batch run batch --scheduler tcp://host:8786",
    ),
    "batch status": ("unveil batch status batch", "unveil batch status batch --json", "unveil batch status batch -q"),
    "batch merge": ("unveil batch merge batch", "unveil batch merge batch --json", "unveil batch merge batch -v"),
    "batch template": (
        "unveil batch template batch --to slurm",
        "unveil batch template batch --to openjd",
        "unveil batch template batch --to flamenco --replace",
    ),
    "doctor": ("unveil doctor", "unveil doctor --json", "unveil doctor -v"),
    "completion": (
        "unveil completion bash > ~/.local/share/bash-completion/completions/unveil",
        "unveil completion zsh > ~/.zfunc/_unveil",
        'eval "$(unveil completion bash)"',
    ),
}
"""By verb. Each line can be typed as it stands."""
