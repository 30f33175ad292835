"""The course of a reconstruction: both stages, each part of them as long as it pays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from unveil_core.base.frame_cache import Frames, subset
from unveil_core.base.progress import Progress
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.optimize.adaptation.choices import CHOICES, Looks
from unveil_core.optimize.adaptation.colour_degree import choose_sh_degree
from unveil_core.optimize.adaptation.probes import hide, probed_frames
from unveil_core.optimize.presets import ReconstructSettings
from unveil_core.optimize.training.arithmetic import torch_in_one_thread
from unveil_core.optimize.training.schedule import Phase, run_phase
from unveil_core.optimize.training.trainer import Optimization
from unveil_core.optimize.training.views import TrainingView
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["Course"]

STABLE, FALLEN = 0.5, 1.2
"""How much of the fall of the step sizes is done in the first stage, and at the end of the second: large steps as long as
they help, then smaller and smaller ones (Hu et al., *MiniCPM*, 2024, section 4). So the first stage may end at any time."""
COARSE, FINE, GEOMETRY = range(3)
"""The phases in their order."""


class Course:
    """Both stages, each part of them as long as it pays.

    Attributes:
        choices: what was chosen by which numbers.
    """

    def __init__(
        self,
        state: Optimization,
        fine: Sequence[TrainingView],
        coarse: Sequence[TrainingView],
        settings: ReconstructSettings,
        checkpoint: Checkpoint,
        progress: Progress,
    ) -> None:
        self.state, self.settings, self.progress = state, settings, progress
        self.checkpoint = checkpoint
        self.fine, self.coarse = fine, coarse
        self.free = frozenset(CHOICES) - settings.given
        self.probed = probed_frames(len(fine)) if self.free else []
        self.looks = Looks(settings.adapt, {"coarse": self._of_probed(coarse), "fine": self._of_probed(fine)})
        self.choices: dict[str, Any] = {}
        self.taken, self.most = 0, settings.iterations
        self.at, self.begun, self.stopped = COARSE, 0, False

    @torch_in_one_thread()
    def run(self) -> tuple[Surfels, Sky]:
        """Take all steps, from the last checkpoint on where there is one."""
        s = self.settings
        first = round(s.iterations * (1 - s.geometry_share))
        if not self._resumed():
            self.state.trainable.set_sh_degree(s.sh_degree)
        if self.at == COARSE:
            self._coarse(round(s.iterations * s.coarse_share))
            self._next(FINE)
        if self.at == FINE:
            self._fine(first - self.taken)
            self._next(GEOMETRY)
        second = self._second()
        phase = Phase("geometry", self.fine, second, True, STABLE, FALLEN, prune_every=max(50, second // 3))
        self._run(phase, lambda: False)
        return self.state.result()

    def _second(self) -> int:
        """Steps of the second stage, and what comes before its first."""
        s = self.settings
        if self.begun:
            return self.most - self.taken
        # The second stage is as long as the first deserved, and sees what was hidden.
        second = round(self.taken * s.geometry_share / (1 - s.geometry_share))
        self.most = self.taken + second
        stopped = "the gain" if self.taken < round(s.iterations * (1 - s.geometry_share)) else "the limit"
        self.choices["iterations"] = {
            "chosen": self.most,
            "most": s.iterations,
            "gain": self.looks.gain(),
            "least_gain": s.adapt.least_gain,
            "stopped_by": stopped,
        }
        self.choices["looks"] = self.looks.record
        # Faint ones go at once: the geometric terms cost per surfel, and what they sharpen should stay.
        self.state.prune()
        return second

    def _next(self, at: int) -> None:
        self.at, self.begun = at, 0

    def _resumed(self) -> bool:
        """Go on from the last checkpoint, where there is one."""
        found = self.checkpoint.load()
        if found is None:
            return False
        arrays, facts = found
        self.state.restore(arrays, facts["state"])
        self.at, self.begun, self.stopped = facts["at"], facts["begun"], facts["stopped"]
        self.taken, self.most, self.choices = facts["taken"], facts["most"], facts["choices"]
        self.looks.work, self.looks.record = facts["work"], facts["record"]
        self.looks.seen = [(float(work), float(psnr)) for work, psnr in facts["seen"]]
        return True

    def _pause(self, turn: int) -> None:
        """Save a checkpoint where it is time to."""
        if self.checkpoint.due():
            arrays, state = self.state.checkpoint()
            looks = {"work": self.looks.work, "record": self.looks.record, "seen": self.looks.seen}
            here = {"at": self.at, "begun": turn, "stopped": self.stopped, "taken": self.taken, "most": self.most}
            self.checkpoint.save(arrays, {"state": state, **looks, **here, "choices": self.choices})

    def _coarse(self, steps: int) -> None:
        """The first steps at half size, without growth: what is there suffices for so few pixels. Then colour's degree."""
        phase = Phase("coarse", self._shown(self.coarse), steps, False, STABLE, STABLE)
        taken = self._run(phase, lambda: "coarse" in self.free and not self.looks.pays())
        self.choices["coarse"] = {"chosen": taken, "most": steps, "gain": self.looks.gain()}
        trial = min(len(self.fine), steps // 8)
        # In fewer steps no degree has had its time: colour by direction would always look useless.
        if self.settings.sh_degree and "sh_degree" in self.free and trial >= max(1, len(self.fine) // 2):
            self.state, self.choices["sh_degree"] = choose_sh_degree(self.state, phase, trial, self.looks)

    def _fine(self, steps: int) -> None:
        """At full size: density control until it does not pay, then steps until they do not."""
        phase = Phase(
            "fine", self._shown(self.fine), steps, False, STABLE, STABLE, grow_every=self.settings.adapt.every
        )

        def ends() -> bool:
            if self.looks.pays():
                return False
            if "budget" in self.free and not self.stopped:
                self.stopped, self.state.density = True, None
                self.choices["budget"] = {
                    "chosen": len(self.state),
                    "most": self.settings.budget,
                    "gain": self.looks.gain(),
                }
                self.looks.begin()
                return False
            return "iterations" in self.free

        self._run(phase, ends)
        self.choices.setdefault("budget", {"chosen": len(self.state), "most": self.settings.budget})
        self.state.density = None

    def _run(self, phase: Phase, ends: Callable[[], bool]) -> int:
        if not self.begun:
            self.looks.begin()

        def watch(state: Optimization, phase: Phase, turn: int) -> bool:
            self.progress(self.taken + turn, self.most, phase.name, loss=state.loss, surfels=float(len(state)))
            return bool(self.probed) and not phase.geometry and self.looks.look(state, phase, turn) and ends()

        taken = run_phase(self.state, phase, watch, begun=self.begun, pause=self._pause)
        self.taken += taken
        return taken

    def _of_probed(self, views: Sequence[TrainingView]) -> Sequence[TrainingView]:
        return subset(views, self.probed)

    def _shown(self, views: Sequence[TrainingView]) -> Sequence[TrainingView]:
        return Frames(len(views), lambda i: hide(views[i]) if i in self.probed else views[i])
