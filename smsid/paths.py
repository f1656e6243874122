"""Where the spacecraft that come with smsid are."""

from __future__ import annotations

from pathlib import Path


def urdf_folder() -> Path:
    """Return the folder of the bundled URDFs and TOMLs (installed beside the package, or of the checkout)."""
    inside = Path(__file__).parent / "urdf"
    return inside if inside.is_dir() else Path(__file__).parent.parent / "urdf"


def bundled_craft(name: str) -> Path | None:
    """Return the TOML of a spacecraft that comes with smsid by its name (``paper_sms``); None for another."""
    found = urdf_folder() / f"{name}.toml"
    return found if name.isidentifier() and found.is_file() else None


def missing_craft_advice(name: str) -> str:
    """Return what to do about a craft that is no file: a bare name may have been meant for another one."""
    if not name.replace("-", "_").isidentifier():
        return "Check the path."
    crafts = " and ".join(sorted(p.stem for p in urdf_folder().glob("*.toml")))
    return f"Check the path. Known by name are {crafts}; `smsid new NAME --arm ROBOT` makes one with an arm."
