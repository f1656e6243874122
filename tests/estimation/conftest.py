"""The recordings and problems that diagnosis is tested on, too."""

from tests.diagnose.conftest import calm, description, flown, known, plain, problem, recording

__all__ = ["calm", "description", "flown", "known", "plain", "problem", "recording"]
