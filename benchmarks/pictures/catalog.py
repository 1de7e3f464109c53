"""Kinds of things by the place where they stand."""

from __future__ import annotations

from devices import appliance, book, lamp, mouse, phone, plant, stick, tape, toy
from groceries import bag, ball, banana, block, bottle, can, carton, jar, lump
from scans import scan
from thing import Maker
from vessels import bowl, crate, kettle, mug, plate, pot, tray

SMALL: tuple[Maker, ...] = (
    carton, block, can, jar, bottle, mug, ball, banana, stick, tape, phone, toy, bag, mouse, book, lump, lump,
    scan, scan,
)  # fmt: skip
STANDING: tuple[Maker, ...] = (
    carton, block, can, jar, bottle, mug, bag, lump, scan, bottle,
)  # fmt: skip
KITCHEN: tuple[Maker, ...] = (
    jar, jar, bottle, bottle, can, mug, bowl, plate, pot, kettle, carton, ball, banana, crate, plant, bag, lump,
    lump, scan,
)  # fmt: skip
DESK: tuple[Maker, ...] = (
    book, book, mug, phone, phone, stick, stick, tape, lamp, plant, bottle, carton, crate, bag, block, toy,
    lump, appliance,
)  # fmt: skip
BIG: tuple[Maker, ...] = (
    carton, appliance, crate, bag, pot, plant,
)  # fmt: skip
# Things on or in which others can stand, and things that a hand can hold.
STACKED: tuple[Maker, ...] = (
    can, carton, block, book, book, tape, scan, bowl, tray, crate, plate, bowl,
)  # fmt: skip
HELD: tuple[Maker, ...] = (can, jar, bottle, carton, block, mug, ball, stick, phone, toy, scan, lump)
