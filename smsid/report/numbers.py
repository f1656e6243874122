"""Numbers as a reader wants them: significant digits, real minus signs and powers of ten."""

from __future__ import annotations

import math
import re

PLAIN, SMALL = 1e6, 1e-3  # numbers between them are written out
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(x: float | None, digits: int = 4) -> str:
    """Return a number with significant digits; powers of ten where plain digits would be long.

    Not-a-number and ``None`` are a dash, infinities a sign.
    """
    if x is None or math.isnan(x):
        return "–"
    if math.isinf(x):
        return "∞" if x > 0 else "−∞"
    text = f"{x + 0.0:.{digits}g}"  # not minus zero
    if "e+" in text and abs(x) < PLAIN:
        text = f"{float(text):.0f}"
    elif 0.0 < abs(float(text)) < SMALL:
        mantissa, _, exponent = f"{x:.{digits - 1}e}".partition("e")
        text = f"{float(mantissa):g}e{exponent}"
    if "e" in text:
        mantissa, _, exponent = text.partition("e")
        return f"{mantissa}·{power(int(exponent))}".replace("-", "−")
    return text.replace("-", "−")


def power(exponent: int) -> str:
    """Return ten to an integer, as on an axis."""
    return {0: "1", 1: "10"}.get(exponent, "10" + str(exponent).translate(_RAISED))


def share(x: float, digits: int = 2) -> str:
    """Return a share as percentage; a dash where there is none: nothing is a share of zero."""
    return f"{number(100.0 * x, digits)} %" if math.isfinite(x) else "–"


def tick_label(x: float) -> str:
    """Return a number as a tick's label: short, and exact for round ones."""
    if x == 0.0:
        return "0"
    return number(float(f"{x:.6g}"), 6)


def half(value: float, low: float, high: float) -> str:
    """Return an interval about a value: ``± h`` where it is symmetric, else its two ends."""
    finite = math.isfinite(low) and math.isfinite(high)
    if finite and abs((high - value) - (value - low)) <= 1e-6 * max(high - low, 1e-300):
        return f"± {number(0.5 * (high - low), 2)}"
    return f"{number(low, 4)} … {number(high, 4)}"


def with_half(value: float, size: float) -> str:
    """Return a value and half its interval, both to the same decimal: ``1.5000 ± 0.0004``."""
    if not (math.isfinite(value) and math.isfinite(size) and size > 0.0):
        return f"{number(value, 4)} ± {number(size, 2)}"
    decimals = 1 - math.floor(math.log10(size)) if size < 10.0 else 0
    if decimals > 6 or abs(value) >= PLAIN:
        return f"{number(value, 4)} ± {number(size, 2)}"
    return f"{value:.{decimals}f} ± {size:.{decimals}f}".replace("-", "−")


def unit(text: str) -> str:
    """Return a unit with raised exponents, which no line breaks; that of a pure number is nothing."""
    return "" if text == "1" else raise_exponents(text).replace(" ", "\N{NO-BREAK SPACE}")


def raise_exponents(text: str) -> str:
    """Return a text with its exponents raised."""
    return re.sub(r"\^(-?\d+)", lambda m: m.group(1).translate(_RAISED), text)
