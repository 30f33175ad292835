"""Perceptual distances by networks that the user brings: LPIPS and FID.

LPIPS: Zhang et al., *The unreasonable effectiveness of deep features as a perceptual metric* (2018). FID: Heusel et al.,
*GANs trained by a two time-scale update rule converge to a local Nash equilibrium* (2017). No weights are shipped. A model is
a TorchScript archive (``.pt``, ``.pts``, ``.torchscript``) or an ONNX file (``.onnx``); both run on the CPU, and neither is
ever unpickled as Python.
"""

from __future__ import annotations

import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import SettingsError
from unveil_core.base.networks.onnx_files import check_readable, open_onnx, short
from unveil_core.base.types import Picture

__all__ = ["FeatureModel", "LpipsModel", "frechet_distance"]

Run = Callable[..., NDArray[np.generic]]

TORCHSCRIPT_SUFFIXES = (".pt", ".pts", ".torchscript")
FEATURE_SIDE = 299


class LpipsModel:
    """LPIPS between two images.

    Args:
        path: a model of two images (1, 3, H, W) float32 RGB in [-1, 1] that gives one number.
    Raises:
        SettingsError: the file is missing, damaged, or no such model.
    """

    WANTED = "give a model that takes two images (1, 3, H, W) in [-1, 1] and gives one number"

    def __init__(self, path: Path) -> None:
        self._model = _Model(path, self.WANTED)

    def __call__(self, a: Picture, b: Picture) -> float:
        """The distance of two images (H, W, 3) uint8 of one size; 0 for what looks the same."""
        found = self._model(*(_batch(image) / np.float32(127.5) - 1 for image in (a, b)))
        if found.size != 1:
            raise self._model.error(f"gives {found.shape} values, not one")
        return float(found.reshape(()))


class FeatureModel:
    """The features of an image that FID compares.

    Images are brought to 299x299 by antialiased bicubic interpolation in floating point, as Parmar et al., *On aliased
    resizing and surprising subtleties in GAN evaluation* (2022), advise. Any normalization beyond [0, 1] is the model's
    own.

    Args:
        path: a model from (N, 3, 299, 299) float32 RGB in [0, 1] to (N, D); it is given one image at a time.
    Raises:
        SettingsError: the file is missing, damaged, or no such model.
    """

    WANTED = "give a model that takes images (N, 3, 299, 299) in [0, 1] and gives features (N, D)"

    def __init__(self, path: Path) -> None:
        self._model = _Model(path, self.WANTED)

    def __call__(self, image: Picture) -> NDArray[np.float64]:
        """(D,) features of an image (H, W, 3) uint8."""
        import torch  # takes seconds, which an evaluation without networks does not pay

        resized = torch.nn.functional.interpolate(
            torch.from_numpy(_batch(image)), size=(FEATURE_SIDE, FEATURE_SIDE), mode="bicubic", antialias=True
        )
        found = self._model(np.clip(resized.numpy() / np.float32(255), 0, 1))
        if found.ndim != 2 or found.shape[0] != 1 or not found.size:
            raise self._model.error(f"gives {found.shape} values for one image, not (1, D)")
        features: NDArray[np.float64] = found[0]
        return features


def frechet_distance(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Squared Fréchet distance of the Gaussians fitted to two sets of features, in float64.

    |m_a - m_b|^2 + tr(S_a + S_b - 2 (S_a S_b)^(1/2)), Dowson and Landau, *The Fréchet distance between multivariate normal
    distributions* (1982). With centred rows A and S_a = A^T A the last trace is the sum of the singular values of A B^T: no
    root of a matrix is taken, which fails where there are fewer images than dimensions, and S_a is never formed.

    Few images make it larger than it is for many: compare only figures of equally many.

    Args:
        a: (N, D), N >= 2; b: (M, D), M >= 2.
    """
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.ndim != 2 or second.ndim != 2 or first.shape[1] != second.shape[1] or min(len(first), len(second)) < 2:
        raise ValueError(
            f"features must be (N, D) and (M, D) of at least two images, not {first.shape}, {second.shape}"
        )
    mean_step = first.mean(axis=0) - second.mean(axis=0)
    roots: list[NDArray[np.float64]] = []
    for rows in (first, second):
        root = (rows - rows.mean(axis=0)) / np.sqrt(len(rows) - 1)
        # The same root with no more rows than dimensions.
        roots.append(np.asarray(np.linalg.qr(root, mode="r")) if len(root) > root.shape[1] else root)
    spread = sum(float(np.square(root).sum()) for root in roots)
    shared = float(np.linalg.svd(roots[0] @ roots[1].T, compute_uv=False).sum())
    return max(float(mean_step @ mean_step) + spread - 2 * shared, 0.0)


def _batch(image: Picture) -> NDArray[np.float32]:
    """(1, 3, H, W), 0 to 255."""
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None], dtype=np.float32)


class _Model:
    """A network from a file: images in, one array out, float64."""

    def __init__(self, path: Path, wanted: str) -> None:
        self.path, self.wanted = Path(path), wanted
        # One at a time: a network needs gigabytes for a large image, and uses all cores by itself.
        self._lock = threading.Lock()
        suffix = self.path.suffix.lower()
        if suffix not in (*TORCHSCRIPT_SUFFIXES, ".onnx"):
            raise self.error(f"Neither TorchScript ({', '.join(TORCHSCRIPT_SUFFIXES)}) nor ONNX (.onnx)")
        check_readable(self.path, wanted)
        if suffix != ".onnx":
            self._refuse_pickles()
        try:
            self._run = _onnx(self.path) if suffix == ".onnx" else _torchscript(self.path)
        except Exception as error:  # whatever the library says about a damaged file
            raise self.error(f"cannot be loaded: {short(error)}") from error

    def error(self, problem: str) -> SettingsError:
        """To be raised about this file."""
        return SettingsError(problem, path=self.path, mend=self.wanted)

    def __call__(self, *images: NDArray[np.float32]) -> NDArray[np.float64]:
        try:
            with self._lock:
                found = self._run(*images)
        except Exception as error:  # a model may fail in any way of its own
            raise self.error(f"does not take {_shapes(images)}: {short(error)}") from error
        values = np.asarray(found, dtype=np.float64)
        if not np.isfinite(values).all():
            raise self.error("gives values that are not finite")
        return values

    def _refuse_pickles(self) -> None:
        """``torch.save`` gives its pickles the same suffix; only a TorchScript archive carries code and constants."""
        try:
            with open_file(self.path) as file, zipfile.ZipFile(file) as archive:
                names = [name.partition("/")[2] for name in archive.namelist()]
        except zipfile.BadZipFile as error:
            raise self.error("Not a TorchScript archive: damaged, or a plain pickle, which is never opened") from error
        if "constants.pkl" not in names or not any(name.startswith("code/") for name in names):
            if "data.pkl" in names:
                raise self.error("Not opened: a plain torch.save pickle; export TorchScript or ONNX from it")
            raise self.error("Not a TorchScript archive")


def _torchscript(path: Path) -> Run:
    import torch

    module = torch.jit.load(str(path), map_location="cpu").eval()  # type: ignore[no-untyped-call]

    def run(*images: NDArray[np.float32]) -> NDArray[np.generic]:
        with torch.no_grad():
            found = module(*(torch.from_numpy(image) for image in images))
        if not isinstance(found, torch.Tensor):
            raise TypeError(f"it gives a {type(found).__name__}, not a tensor")
        return found.numpy()

    return run


def _onnx(path: Path) -> Run:
    session = open_onnx(path)
    inputs, outputs = session.inputs, session.outputs
    session.tried()  # its first pictures are large: they may take long, and can be ended

    def run(*images: NDArray[np.float32]) -> NDArray[np.generic]:
        if len(inputs) != len(images) or len(outputs) != 1:
            raise TypeError(f"it has {len(inputs)} inputs and {len(outputs)} outputs")
        found = session.run({i.name: image for i, image in zip(inputs, images, strict=True)})[0]
        if not isinstance(found, np.ndarray):
            raise TypeError(f"it gives a {type(found).__name__}, not a tensor")
        return found

    return run


def _shapes(images: tuple[NDArray[np.float32], ...]) -> str:
    return " and ".join(str(image.shape) for image in images)
