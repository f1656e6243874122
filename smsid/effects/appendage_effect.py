"""What effects on an appendage share: they name it, and find it and its modes in the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from smsid.effects.assembly import AppendageJoints, Assembly
from smsid.effects.base import Effect
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.effects.appendage import BeamAppendage, Mode


class AppendageEffect(Effect):
    """An effect on an appendage that stands before it."""

    family = "appendage"
    appendage: str = Field(description="name of the appendage, which stands before this effect")

    def part_of(self) -> str:
        """Return the appendage."""
        return self.appendage

    def panel(self, assembly: Assembly) -> AppendageJoints:
        """Return the appendage as it is attached; raises `DescriptionError` without it."""
        for panel in assembly.appendages:
            if panel.appendage.name == self.appendage:
                return panel
        known = ", ".join(p.appendage.name for p in assembly.appendages) or "none"
        raise DescriptionError(
            f"There is no appendage '{self.appendage}' before this effect.",
            advice=f"So far: {known}.",
            appendage=self.appendage,
        )


class BeamEffect(AppendageEffect):
    """An effect that only a beam can have."""

    appendage: str = Field(description="name of a `beam_appendage`, which stands before this effect")

    def beam(self, assembly: Assembly) -> tuple[AppendageJoints, BeamAppendage]:
        """Return it where it is a beam; raises `DescriptionError` of any other."""
        from smsid.effects.appendage import BeamAppendage

        panel = self.panel(assembly)
        if not isinstance(panel.appendage, BeamAppendage):
            raise DescriptionError(
                f"'{self.appendage}' is no beam_appendage, so {self.needs_beam} not known.",
                advice="Leave the effect out (`extra_mode` adds a mode to any), or describe it as a beam.",
            )
        return panel, panel.appendage


class ModeEffect(AppendageEffect):
    """An effect on one mode of an appendage."""

    mode: int = Field(default=1, ge=1, description="number of the mode, from 1")

    def mode_joint(self, assembly: Assembly) -> tuple[int, Mode, float]:
        """Return the mode's joint, the mode, and its mass by the joint's coordinate [kg | kg m^2].

        Raises `DescriptionError` without such a mode.
        """
        panel = self.panel(assembly)
        modes = panel.appendage.modal_data()
        if self.mode > len(modes):
            raise DescriptionError(
                f"'{self.appendage}' has {len(modes)} modes, not {self.mode}.",
                advice="Count from 1.",
                mode=self.mode,
            )
        k = self.mode - 1
        return panel.joints[k], modes[k], float(panel.scale[k]) ** 2
