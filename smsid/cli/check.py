"""``smsid check``: all that is wrong or doubtful in a description."""

from __future__ import annotations

from smsid.cli.errors import Outcome
from smsid.cli.options import DescriptionPath
from smsid.cli.output import say
from smsid.errors import SmsidError


def check_command(description: DescriptionPath) -> Outcome:
    """Tell all that is wrong or doubtful in a description, its URDFs and the model; exit code 1 if wrong."""
    from smsid.cli.file_kind import kind_of
    from smsid.model.review import review_description

    kind = kind_of(
        description
    )  # a file that is not there is no description with faults, another kind neither
    if kind != "description":
        raise SmsidError(
            f"'{description}' is of the kind '{kind.replace('_', ' ')}', no description.",
            advice="Give the TOML or URDF of the spacecraft.",
        )
    found = review_description(description)
    for label, findings in (("wrong", found.wrong), ("doubtful", found.doubtful)):
        for text in findings:
            say(f"{label}: {text}")
    say(f"{len(found.wrong)} wrong, {len(found.doubtful)} doubtful")
    document = {"wrong": list(found.wrong), "doubtful": list(found.doubtful)}
    return Outcome(document, exit_code=1 if found.wrong else 0)
