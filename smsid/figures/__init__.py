"""Figures for papers, drawn by matplotlib: PNG, SVG or PDF (extra: plot)."""

from smsid.figures._canvas import picture, save
from smsid.figures.draw import KINDS, draw

__all__ = ["KINDS", "draw", "picture", "save"]
