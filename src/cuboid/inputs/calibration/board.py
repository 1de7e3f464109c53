"""A ChArUco board (a chessboard with ArUco markers, by OpenCV): its size, its corners in an image, its PDF."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError

# A marker fills this fraction of its square: with 4 x 4 bits and a border, the modules of the print are a tenth of a
# square, so that they can be drawn on one grid.
MARKER, MODULES = 0.6, 10
# Half the window in which a corner is refined, as a fraction of a square: within its white margin around the marker.
WINDOW, MIN_WINDOW_PX = (1 - MARKER) / 2, 2
REFINED = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 0.001)
DICTIONARY, MARKERS = cv2.aruco.DICT_4X4_250, 250
# Fewest corners with which a view of a board counts: its pose has six numbers, and a corner gives two.
MIN_CORNERS = 6
# Fewest markers that tell where the board is; a corner lies nearer to its place than this, pixels.
MIN_MARKERS, MAX_OFF_PX = 2, 1.5
# Margin around a printed board, which detection needs to be white; edge that printers leave out; both millimetres.
MARGIN_MM = 5.0
POINTS_PER_MM = 72.0 / 25.4
# Paper by name: width and height, landscape, millimetres (ISO 216).
PAPER_MM = {
    "A4": (297.0, 210.0),
    "A3": (420.0, 297.0),
    "A2": (594.0, 420.0),
    "A1": (841.0, 594.0),
    "A0": (1189.0, 841.0),
}
# Length of the line by which a print is checked, millimetres.
CHECKED_MM = 100.0


@dataclass(frozen=True)
class Board:
    """A ChArUco board.

    Attributes
    ----------
    columns, rows : int
        Number of squares.
    square_m : float
        Side of a square, metres.
    """

    columns: int = 7
    rows: int = 5
    square_m: float = 0.038

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}x{1000 * self.square_m:g}mm"

    @cached_property
    def _charuco(self) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, MARKER * self.square_m, dictionary)

    @cached_property
    def _detector(self) -> Any:
        return cv2.aruco.CharucoDetector(self._charuco)

    @cached_property
    def corners(self) -> Float64Array:
        """The inner corners (N, 3) on the board, metres: x along a row, y down, z into the board."""
        return np.asarray(self._charuco.getChessboardCorners(), np.float64)

    @property
    def modules(self) -> npt.NDArray[np.bool_]:
        """Which modules of the print (rows x 10, columns x 10) are black."""
        size = self.columns * MODULES, self.rows * MODULES
        return np.asarray(self._charuco.generateImage(size, marginSize=0, borderBits=1) < 128)

    def find(self, color: UInt8Array) -> tuple[npt.NDArray[np.int64], Float64Array]:
        """Return the numbers (N,) and the pixels (N, 2) of the corners in an image; none if they are too few.

        Some markers tell where the board is; each corner is then refined at the place where it must be.
        """
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        _, _, markers, ids = self._detector.detectBoard(gray)
        none = np.zeros(0, np.int64), np.zeros((0, 2))
        if ids is None:
            return none
        known = dict(zip(self._charuco.getIds().ravel().tolist(), self._charuco.getObjPoints(), strict=True))
        seen = [
            (known[k], one.reshape(4, 2)) for k, one in zip(ids.ravel().tolist(), markers, strict=True) if k in known
        ]
        if len(seen) < MIN_MARKERS:
            return none
        places = self._places(np.concatenate([at[:, :2] for at, _ in seen]), np.concatenate([px for _, px in seen]))
        if places is None:
            return none
        apart_px = np.linalg.norm(places[:, None] - places, axis=-1)
        half = max(MIN_WINDOW_PX, int(WINDOW * np.where(apart_px > 0, apart_px, np.inf).min()))
        inside = ((places > half + 1) & (places < np.array(gray.shape[::-1]) - half - 2)).all(1)
        numbers = np.flatnonzero(inside)
        if len(numbers) < MIN_CORNERS:
            return none
        start = places[numbers].astype(np.float32)
        pixels = cv2.cornerSubPix(gray, start.copy(), (half, half), (-1, -1), REFINED).astype(np.float64)
        places = self._places(self.corners[numbers, :2], pixels)
        if places is None:
            return none
        good = np.linalg.norm(places[numbers] - pixels, axis=1) < MAX_OFF_PX
        return (numbers[good], pixels[good]) if good.sum() >= MIN_CORNERS else none

    def _places(self, points: Float64Array, pixels: Float64Array) -> Float64Array | None:
        """Return the pixels (N, 2) of all corners, from some points (M, 2) of the board; None if they do not fit."""
        H, fits = cv2.findHomography(points, pixels, cv2.RANSAC, MAX_OFF_PX)
        if H is None or fits.sum() < max(MIN_CORNERS, len(points) / 2):
            return None
        return np.asarray(cv2.perspectiveTransform(self.corners[None, :, :2], H)[0], np.float64)


def board_of(text: str) -> Board:
    """Return the board of COLUMNSxROWSxSIDEmm, such as 7x5x38mm.

    Raises
    ------
    ValueError
        The text has another form, or there is no such board.
    """
    found = re.fullmatch(r"(\d{1,3})x(\d{1,3})x(\d{1,4}(?:\.\d{1,4})?)mm", text)
    if found is None:
        raise ValueError(f"expected COLUMNSxROWSxSIDEmm with the number and the side of the squares, got '{text}'")
    columns, rows, side_mm = int(found[1]), int(found[2]), float(found[3])
    if min(columns, rows) < 3 or columns * rows // 2 > MARKERS or side_mm <= 0:
        raise ValueError(f"a board has 3 or more columns and rows and at most {2 * MARKERS} squares, got '{text}'")
    return Board(columns, rows, side_mm / 1000)


def board_pdf(board: Board) -> bytes:
    """Return a PDF of one page with a board at its true size, on the smallest paper that it fits.

    Raises
    ------
    InputError
        The board is larger than every paper.
    """
    width_mm, height_mm = (1000 * board.square_m * count for count in (board.columns, board.rows))
    fits = [
        (name, size)
        for name, size in PAPER_MM.items()
        if width_mm + 2 * MARGIN_MM <= size[0] and height_mm + 4 * MARGIN_MM <= size[1]
    ]
    if not fits:
        raise InputError(f"a board of {width_mm:g} x {height_mm:g} mm is larger than A0; take smaller squares")
    paper, (page_w_mm, page_h_mm) = fits[0]
    left_mm, top_mm = (page_w_mm - width_mm) / 2, page_h_mm - MARGIN_MM
    side_mm = 1000 * board.square_m / MODULES
    marks = [
        _rectangle(left_mm + first * side_mm, top_mm - (row + 1) * side_mm, (last - first) * side_mm, side_mm)
        for row, black in enumerate(board.modules)
        for first, last in _runs(black)
    ]
    foot_mm = (top_mm - height_mm) / 2
    marks.append(_rectangle(left_mm, foot_mm, CHECKED_MM, 0.3))
    text = f"{board}, {paper}, print at 100 %: the line is {CHECKED_MM:g} mm long"
    at = " ".join(f"{value * POINTS_PER_MM:.4f}" for value in (left_mm + CHECKED_MM + 4, foot_mm - 1))
    marks.append(f"BT /F 9 Tf {at} Td ({text}) Tj ET")
    return _pdf(page_w_mm, page_h_mm, "\n".join(marks).encode("ascii"))


def _runs(black: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of each run of black modules in a row."""
    changes = np.flatnonzero(np.diff(np.concatenate(([False], black, [False])).astype(np.int8)))
    return list(zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True))


def _rectangle(x_mm: float, y_mm: float, width_mm: float, height_mm: float) -> str:
    """Return a filled rectangle in the language of PDF, from its lower left corner."""
    values = (value * POINTS_PER_MM for value in (x_mm, y_mm, width_mm, height_mm))
    return " ".join(f"{value:.4f}" for value in values) + " re f"


def _pdf(width_mm: float, height_mm: float, content: bytes) -> bytes:
    """Return a PDF (ISO 32000-1) of one page with this content."""
    box = f"[0 0 {width_mm * POINTS_PER_MM:.4f} {height_mm * POINTS_PER_MM:.4f}]"
    fonts = "<< /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >>"
    # Viewers are asked not to scale the page when they print it.
    entries = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R /Resources << /Font {fonts} >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
    ]
    out, starts = b"%PDF-1.6\n", []
    for number, entry in enumerate(entries, 1):
        starts.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, entry)
    table = b"".join(b"%010d 00000 n \n" % start for start in starts)
    count = len(entries) + 1
    return out + b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        count,
        table,
        count,
        len(out),
    )
