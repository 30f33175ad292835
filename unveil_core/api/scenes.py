"""The scene of a workspace: surfels and sky, rendered as ``unveil render`` shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, overload

from numpy.typing import NDArray

from unveil_core.app.render_views import check_planes, read_scene, rendered_planes
from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import DEVICES, chosen_device, working_on
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import load_labels

if TYPE_CHECKING:
    from unveil_core.workspace.workspace import Workspace

__all__ = ["DeviceName", "Scene"]

DeviceName = Literal["auto", "cpu", "cuda"]


@dataclass(frozen=True, eq=False)
class Scene:
    """A street in surfels, in the drive's local metres, z up.

    Attributes:
        state: "full" or "empty".
        surfels: N surfels as tensors: ``means`` (N, 3), ``quats`` (N, 4) wxyz, ``log_scales`` (N, 2), ``opacity_logits`` (N,),
            ``sh`` (N, (L+1)^2, 3), ``labels`` (N,).
        sky: what is seen where they leave light through.
        labels: the labels that occur: ``labels.labels.names[k]`` is the class of surfels with label k.
    """

    state: str
    surfels: Surfels
    sky: Sky
    labels: SceneLabels

    @staticmethod
    def of(workspace: Workspace, state: str) -> Scene:
        """Read the scene of a workspace.

        Raises:
            SettingsError: an unknown state. WorkspaceError: it was not made yet.
        """
        return Scene(state, *read_scene(workspace, state), load_labels(workspace))

    def __repr__(self) -> str:
        return f"Scene({self.state!r}, {len(self.surfels)} surfels)"

    @overload
    def render(self, camera: Camera, planes: str = "rgb", *, device: DeviceName = "auto") -> NDArray[Any]: ...
    @overload
    def render(
        self, camera: Camera, planes: tuple[str, ...] | list[str], *, device: DeviceName = "auto"
    ) -> tuple[NDArray[Any], ...]: ...
    def render(
        self, camera: Camera, planes: str | Sequence[str] = "rgb", *, device: DeviceName = "auto"
    ) -> NDArray[Any] | tuple[NDArray[Any], ...]:
        """Render the scene, its sky included, from any camera.

        ========= =====================================================================================================
        rgb       (H, W, 3) uint8 sRGB
        depth     (H, W) float32 metres along the optical axis, 0 for none
        normal    (H, W, 3) float32 unit normals in the camera's frame: x right, y up, z towards the viewer; 0 for none
        alpha     (H, W) float32, the light that surfels stop
        semantics (H, W) uint8 trainIds of Cityscapes, 255 for none
        ========= =====================================================================================================

        Args:
            camera: a frame's, or ``frame.camera.moved(right=1.5)``.
            planes: the name of one, or several.
            device: that renders: "cpu"; "cuda", an NVIDIA GPU; or "auto", the GPU where there is one that can be used.
        Returns:
            the plane, or a tuple of them in the order of the names.
        Raises:
            SettingsError: no plane or device of that name, or "cuda" where no GPU can be used.
        """
        names = (planes,) if isinstance(planes, str) else tuple(planes)
        check_planes(names)
        if device not in DEVICES:
            raise SettingsError(f"Not a choice of device: {device!r}", mend=f"use one of {', '.join(DEVICES)}")
        with working_on(chosen_device(device)):
            found = rendered_planes(self.surfels, self.sky, camera, names, self.labels)
        return found[names[0]] if isinstance(planes, str) else tuple(found[name] for name in names)
