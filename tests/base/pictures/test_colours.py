"""What pictures' colours are, and their light: by published numbers, and as LittleCMS converts them."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.base.pictures.profiles import (
    ADOBE,
    COLUMNS,
    GAMMA,
    LINEAR,
    OF_SRGB,
    P3,
    PROPHOTO,
    REC2020,
    SRGB,
    STEPS,
    profile,
)
from unveil_core.base.pictures.colours import SRGB as PLAIN
from unveil_core.base.pictures.colours import Colours, colours_of
from unveil_core.base.pictures.metadata import Metadata
from unveil_core.exports.color import in_rec709

D65 = (0.9505, 1.0, 1.0891)
NAMES = {
    "sRGB": ("srgb_rec709_display", "lin_rec709_scene"),
    "Display P3": ("srgb_p3d65_display", "lin_p3d65_scene"),
    "Adobe RGB (1998)": ("g22_adobergb_display", "lin_adobergb_scene"),
    "Rec. 2020": ("", "lin_rec2020_scene"),
    "ProPhoto RGB": ("", ""),
}


def of_profile(content: bytes) -> Colours:
    return colours_of(Metadata(content))


@pytest.mark.parametrize("version", [2, 4])
@pytest.mark.parametrize(
    ("name", "columns", "curve"),
    [
        ("sRGB", SRGB, OF_SRGB),
        ("sRGB", SRGB, STEPS),
        ("Display P3", P3, OF_SRGB),
        ("Display P3", P3, STEPS),
        ("Adobe RGB (1998)", ADOBE, GAMMA(563 / 256)),
        ("ProPhoto RGB", PROPHOTO, GAMMA(1.8)),
    ],
)
def test_well_known_colours_are_known_by_their_numbers(
    name: str, columns: tuple[tuple[float, ...], ...], curve: bytes, version: int
) -> None:
    found = of_profile(profile("whatever it is called", columns, curve, version=version))
    assert (found.encoded, found.linear) == NAMES[name]
    assert found.name in (name, "whatever it is called") and found.is_known
    assert found.is_srgb == (name == "sRGB")


def test_colours_without_a_name_have_their_own_numbers() -> None:
    found = of_profile(profile("Rec. 2020, gamma 2", REC2020, GAMMA(2.0)))
    assert (found.name, found.encoded, found.linear) == ("Rec. 2020, gamma 2", "", "lin_rec2020_scene")
    np.testing.assert_allclose(found.light(np.full((1, 1, 3), 0.5)), 0.25, atol=1e-6)
    wide = ((0.6, 0.28, 0.0), (0.2, 0.68, 0.05), (0.1642, 0.04, 0.7749))
    own = of_profile(profile("A camera", wide, LINEAR, version=2, white=D65))
    assert own.name == "A camera" and not own.linear and own.chromaticities is not None
    np.testing.assert_allclose(own.chromaticities[6:], (0.3127, 0.329), atol=2e-4)


@pytest.mark.parametrize(
    ("code", "numbers", "at_half"),
    [
        (0, (2.0,), 0.25),
        (1, (2.0, 0.5, 0.5), 0.5625),
        (2, (2.0, 0.5, 0.5, 0.1), 0.6625),
        (3, (2.0, 1.0, 0.0, 0.25, 0.6), 0.125),
        (3, (2.0, 1.0, 0.0, 0.25, 0.4), 0.25),
        (4, (2.0, 1.0, 0.0, 0.25, 0.4, 0.1, 0.2), 0.35),
        (4, (2.0, 1.0, 0.0, 0.25, 0.6, 0.1, 0.2), 0.325),
    ],
)
def test_curves_that_are_formulas(code: int, numbers: tuple[float, ...], at_half: float) -> None:
    """By the table of parametric curves of the standard."""
    fixed = struct.pack(f">{len(numbers)}i", *(round(v * 65536) for v in numbers))
    curve = b"para" + bytes(4) + struct.pack(">HH", code, 0) + fixed
    found = of_profile(profile("x", P3, curve))
    np.testing.assert_allclose(found.light(np.full((1, 1, 3), 0.5)), at_half, atol=1e-4)


@pytest.mark.parametrize("name", ["Display P3", "Adobe RGB (1998)", "ProPhoto RGB"])
def test_they_become_srgb_as_by_littlecms(name: str) -> None:
    cms = pytest.importorskip("PIL.ImageCms")
    from PIL import Image

    curve = {"Display P3": STEPS, "Adobe RGB (1998)": GAMMA(563 / 256), "ProPhoto RGB": GAMMA(1.8)}[name]
    content = profile(name, COLUMNS[name], curve, version=2, white=D65 if "Pro" not in name else (0.9642, 1, 0.8249))
    picture = np.random.default_rng(0).integers(40, 216, (16, 16, 3)).astype(np.uint8)
    picture[:8] = picture[:8].mean(axis=2, keepdims=True)  # greys stay greys
    target = cms.createProfile("sRGB")
    theirs = cms.profileToProfile(Image.fromarray(picture), cms.ImageCmsProfile(io.BytesIO(content)), target, 1)
    ours = in_rec709(picture / 255, of_profile(content))
    assert np.abs(ours * 255 - np.asarray(theirs).astype(float)).max() < 2.1


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (profile("Office printer", None, kind=b"CMYK"), "sRGB"),
        (profile("cut", P3)[:200], "sRGB"),
        (b"\0" * 300, "sRGB"),
        (profile("Grey, gamma 2.2", None, GAMMA(2.2), kind=b"GRAY"), "Grey, gamma 2.2"),
        (profile("Grey of sRGB", None, STEPS, kind=b"GRAY"), "sRGB"),
    ],
)
def test_profiles_that_are_none_of_a_screen(content: bytes, name: str) -> None:
    assert of_profile(content).name == name


def test_a_profile_of_tables_is_told_and_taken_for_srgb() -> None:
    found = of_profile(profile("A scanner", None, kind=b"RGB ", more=[(b"A2B0", b"mft2" + bytes(40))]))
    assert found.name == "A scanner" and not found.is_known and not found.is_srgb
    np.testing.assert_allclose(found.light(np.full((1, 1, 3), 0.5)), PLAIN.light(np.full((1, 1, 3), 0.5)))


def chunks(**own: bytes) -> Metadata:
    return Metadata(chunks=tuple((name.encode(), content) for name, content in own.items()))


P3_CORNERS = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)


@pytest.mark.parametrize(
    ("metadata", "name"),
    [
        (Metadata(), "sRGB"),
        (chunks(cICP=bytes((12, 13, 0, 1))), "Display P3"),
        (chunks(cICP=bytes((1, 13, 0, 1)), sRGB=b"\0"), "sRGB"),
        (chunks(cICP=bytes((9, 16, 0, 1))), "H.273 9, 16"),
        (chunks(sRGB=b"\0", gAMA=struct.pack(">I", 100000)), "sRGB"),
        (chunks(gAMA=struct.pack(">I", 45455)), "sRGB"),
        (chunks(gAMA=struct.pack(">I", 100000)), "gamma 1"),
        (chunks(gAMA=struct.pack(">I", 45455), cHRM=P3_CORNERS), "gamma 2.2"),
        (chunks(gAMA=struct.pack(">I", 0)), "sRGB"),
        (Metadata(profile("x", P3), chunks=((b"sRGB", b"\0"),)), "Display P3"),
    ],
)
def test_chunks_of_a_png_in_their_order(metadata: Metadata, name: str) -> None:
    assert colours_of(metadata).name == name


@given(at=st.integers(0, 600), noise=st.binary(min_size=1, max_size=8))
def test_damaged_profiles_are_colours_all_the_same(at: int, noise: bytes) -> None:
    whole = profile("Display P3", P3, STEPS)[:700]
    content = whole[:at] + noise + whole[at + len(noise) :]
    found = colours_of(Metadata(content))
    light = found.light(np.linspace(0, 1, 9).reshape(1, 3, 3))
    assert light.shape == (1, 3, 3)
