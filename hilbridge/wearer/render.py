"""The head camera of the simulated wearer: a kitchen table, six coloured objects, two hands. Drawn with OpenCV, by numbers:
a picture is one plane of indices into the person's palette.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

# OpenCV hues (0..179) of the six objects, away from the skin's.
OBJECT_HUES = (37, 67, 97, 113, 142, 172)
RADIUS = 0.055  # of the picture's height
SHIFT = 4  # sub-pixel bits for cv2 drawing, so that a small picture shows small movements too

Colour = tuple[int, int, int]
TABLE, WALL, SKIN, SLEEVE, OBJECTS = range(5)  # rows of the palette; the objects are all from OBJECTS on


@dataclass(frozen=True, slots=True)
class Scene:
    """The look of one person's kitchen: `palette` has an RGB colour a row."""

    palette: NDArray[np.uint8]

    @staticmethod
    def of_person(rng: np.random.Generator) -> Scene:
        """Draw table, light and skin; object hues stay recognisable (shift of at most 5 of 180)."""
        light = rng.uniform(0.75, 1.1)
        shift = rng.uniform(-5.0, 5.0)

        def rgb(hue: float, saturation: float, value: float) -> Colour:
            hsv = np.array([[[hue % 180, min(255, saturation), min(255, value * light)]]]).astype(np.uint8)
            red, green, blue = (int(number) for number in cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0])
            return red, green, blue

        table = rgb(rng.uniform(10, 20), rng.uniform(20, 60), rng.uniform(120, 190))
        wall = rgb(rng.uniform(0, 179), rng.uniform(5, 25), rng.uniform(150, 220))
        skin = rgb(rng.uniform(6, 12), rng.uniform(80, 130), rng.uniform(120, 220))
        sleeve = rgb(rng.uniform(0, 179), rng.uniform(10, 40), rng.uniform(40, 120))
        objects = [rgb(hue + shift, 190, 200) for hue in OBJECT_HUES]
        return Scene(np.array([table, wall, skin, sleeve, *objects], dtype=np.uint8))


def draw(
    size_px: tuple[int, int],
    places: Sequence[tuple[float, float]],
    scale: Sequence[float],
    palms: Sequence[tuple[float, float]],
    sway: tuple[float, float],
) -> NDArray[np.uint8]:
    """One picture (height, width) of palette rows. Places and palms in 0..1 of it, scale per object, head sway added."""
    width, height = size_px
    picture = np.empty((height, width), dtype=np.uint8)
    edge = max(0, int((0.12 + sway[1]) * height))
    picture[:edge] = WALL
    picture[edge:] = TABLE
    across, down = width << SHIFT, height << SHIFT
    for colour, ((x, y), factor) in enumerate(zip(places, scale, strict=True), OBJECTS):
        centre = round((x + sway[0]) * across), round((y + sway[1]) * down)
        cv2.circle(picture, centre, round(RADIUS * factor * down), colour, -1, cv2.LINE_8, SHIFT)
    thick = max(1, round(0.07 * height))
    for (x, y), elbow_x in zip(palms, (0.15, 0.85), strict=True):
        palm, elbow = (round(x * across), round(y * down)), (round(elbow_x * across), round(1.15 * down))
        cv2.line(picture, palm, elbow, SLEEVE, thick, cv2.LINE_8, SHIFT)
        cv2.circle(picture, palm, round(0.055 * down), SKIN, -1, cv2.LINE_8, SHIFT)
    return picture
