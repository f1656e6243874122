"""What changed between two estimates of a spacecraft: parameter by parameter, jointly, in physical words."""

from smsid.comparison.compare import compare
from smsid.comparison.result import (
    Comparison,
    Finding,
    load_comparison,
    save_comparison,
)

__all__ = [
    "Comparison",
    "Finding",
    "compare",
    "load_comparison",
    "save_comparison",
]
