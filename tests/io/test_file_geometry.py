"""What files state about their picture: panoramas, pixels that are not square, drones."""

from __future__ import annotations

import pytest
from PIL import Image

from physic_core.errors import InputError
from physic_core.io.photo import read_photo

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "AVIF")


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    "xmp",
    [
        b'<rdf:Description GPano:ProjectionType="equirectangular"/>',
        b"<GPano:ProjectionType>cylindrical</GPano:ProjectionType>",
    ],
)
def test_a_panorama_of_any_shape_is_refused(stored, kind, xmp):
    with pytest.raises(InputError, match="it is a panorama"):
        read_photo(stored(kind, xmp=xmp))


def test_a_phones_panorama_is_refused_by_its_tag_and_a_portrait_is_read(stored):
    apple = {0x010F: "Apple"}
    with pytest.raises(InputError, match="panorama"):
        read_photo(stored("JPEG", exif={**apple, 0xA401: 6}))
    assert read_photo(stored("JPEG", exif={**apple, 0xA401: 7})).warnings == ()
    flat = b'<rdf:Description GPano:ProjectionType="rectilinear"/>'
    assert read_photo(stored("JPEG", xmp=flat)).warnings == ()


@pytest.mark.parametrize(
    "caption",
    [
        b'<dc:title>made with GPano:ProjectionType="equirectangular"</dc:title>',
        b'<rdf:Description dc:title="ProjectionType=equirectangular"/>',
        b"""<rdf:Description dc:title='a GPano:ProjectionType="equirectangular" of it'/>""",
        b"<dc:title>a &gt; ProjectionType>equirectangular</dc:title>",
        b'<dc:title>GimbalPitchDegree="-90" RelativeAltitude="12"</dc:title>',
    ],
)
def test_words_of_a_caption_are_no_tag(stored, caption):
    photo = read_photo(stored("JPEG", xmp=caption))
    assert (photo.notes, photo.up) == ((), None)


RESOLUTION = {0x011A: 72.0, 0x011B: 36.0}
STRETCHED = {
    "JPEG": ("JPEG", {"dpi": (72, 36)}, "2 times its height"),
    "PNG": ("PNG", {"dpi": (36, 72)}, "2 times its width"),
    "TIFF": ("TIFF", {"dpi": (72, 36)}, "2 times its height"),
    "EXIF in WebP": ("WEBP", {"exif": RESOLUTION}, "2 times its height"),
    "EXIF in AVIF": ("AVIF", {"exif": RESOLUTION}, "2 times its height"),
    "turned": ("WEBP", {"exif": {**RESOLUTION, 0x0112: 6}}, "2 times its width"),
}


@pytest.mark.parametrize("name", STRETCHED)
def test_pixels_that_are_not_square_are_named_with_the_size_that_mends_them(stored, name):
    kind, options, size = STRETCHED[name]
    photo = read_photo(stored(kind, **options))
    (warning,) = photo.warnings
    assert warning.endswith(f"resize it to {size}")


@pytest.fixture
def jfif(stored):
    """A JPEG with a density without a unit in its header."""

    def make(x, y):
        content = bytearray(stored("JPEG"))
        place = content.index(b"JFIF\0") + 7
        content[place : place + 5] = bytes([0, 0, x, 0, y])
        return bytes(content)

    return make


@pytest.mark.parametrize(("x", "y"), [(2, 1), (1, 2)])
def test_a_density_without_a_unit_has_two_readings(jfif, x, y):
    (warning,) = read_photo(jfif(x, y)).warnings
    assert "height" in warning
    assert "width" in warning


def test_the_lens_of_a_photo_with_stretched_pixels_is_not_known(stored):
    exif = {0xA405: 26, **RESOLUTION}
    photo = read_photo(stored("WEBP", exif=exif))
    assert photo.intrinsics is None
    assert len(photo.warnings) == 1
    assert read_photo(stored("WEBP", exif={0xA405: 26})).intrinsics is not None


@pytest.mark.parametrize(
    ("size", "right"),
    [
        ((960, 1080), "are not square: resize it to 1920 x 1080"),
        ((1440, 1080), "may not be square"),
        ((704, 480), "640 x 480 px, or 854 x 480"),
        ((640, 720), "are not square: resize it to 1280 x 720"),
        ((1920, 540), "are not square: resize it to 1920 x 1080"),
        ((176, 144), "768 x 576"),
        ((960, 720), ""),
        ((1280, 720), ""),
        ((1080, 1920), ""),
    ],
)
def test_the_sizes_of_recorders_are_named(stored, size, right):
    picture = Image.new("RGB", size, (90, 120, 150))
    photo = read_photo(stored("JPEG", picture))
    assert [right in text for text in photo.warnings] == ([True] if right else [])
    of_camera = read_photo(stored("JPEG", picture, exif={0x010F: "Maker"}))
    assert (of_camera.warnings, of_camera.notes) == ((), ())


def of_drone(pitch, roll="+0.00"):
    """XMP as DJI writes it."""
    return (
        f'<rdf:Description drone-dji:RelativeAltitude="+12.40" '
        f'drone-dji:GimbalRollDegree="{roll}" drone-dji:GimbalPitchDegree="{pitch}"/>'
    ).encode()


def test_the_height_that_a_drone_states_is_a_note(stored):
    (note,) = read_photo(stored("JPEG", xmp=of_drone("-35.10"))).notes
    assert "12.4 m" in note


@pytest.mark.parametrize(
    ("pitch", "up"),
    [("+0.00", (0, -1, 0)), ("-90.00", (0, 0, -1)), ("-30.00", (0, -(0.75**0.5), -0.5))],
)
@pytest.mark.parametrize("kind", FORMATS)
def test_up_is_against_gravity_by_the_pitch_of_a_gimbal(stored, kind, pitch, up):
    assert read_photo(stored(kind, xmp=of_drone(pitch))).up == pytest.approx(up)


def test_a_turned_or_rolled_picture_states_no_up(stored):
    assert read_photo(stored("JPEG", xmp=of_drone("-20.00", roll="-90.00"))).up is None
    assert read_photo(stored("JPEG", xmp=of_drone("-20.00"), exif={0x0112: 6})).up is None
    assert read_photo(stored("JPEG")).up is None


@pytest.mark.parametrize(("x", "y"), [(1, 1), (100, 101), (200, 72)])
def test_square_pixels_and_mistakes_are_not_named(jfif, x, y):
    assert read_photo(jfif(x, y)).warnings == ()
