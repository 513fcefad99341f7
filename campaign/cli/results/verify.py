"""``clearcap verify``: check without the server whether an exported campaign is what was signed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.reports.signing.verification import VerifiedSignoff


def verify(
    export: Annotated[Path, typer.Argument(metavar="FILE.zip|FOLDER", help="What a server exported.")],
    key: Annotated[
        str | None, typer.Option(metavar="FINGERPRINT", help="Fingerprint of the server's key, as the server shows it.")
    ] = None,
    json: Json = False,
) -> None:
    """Verify who signed an exported campaign, and that plan, rows and report are the ones that were signed.

    Exit status 1 says that they are not, or that the export cannot be trusted. Nothing is unpacked.
    """
    from campaign.reports.signing.signed_archive import open_archive
    from campaign.reports.signing.verification import verify_export

    proof = verify_export(open_archive(export), key)
    if json:
        signoffs = [
            {"number": each.number, "differences": each.differences, **each.signoff.model_dump(exclude={"files"})}
            for each in proof.signoffs
        ]
        print_json({"campaign": proof.campaign, "key": proof.key, "signoffs": signoffs, "faults": proof.faults})
    else:
        print_text(f"{proof.campaign}, signed with the key {proof.key}")
        for signed in proof.signoffs:
            _print_signoff(signed)
        if not proof.faults:
            files = len(proof.signoffs[-1].signoff.files)
            print_text(f"intact: all {files} files are those of the last sign-off")
    if key is None:
        say("the key is the export's own; give --key FINGERPRINT, from the server or the approver, to know whose it is")
    for fault in proof.faults:
        say(fault)
    if proof.faults:
        raise typer.Exit(1)


def _print_signoff(signed: "VerifiedSignoff") -> None:
    """Print who signed what and when."""
    signoff = signed.signoff
    eyes = (
        "who also submitted it" if signoff.is_submitter else f"submitted by {signoff.submitted_by or 'an unknown user'}"
    )
    covered = "another version" if signed.differences else "plan, rows and report"
    print_text(f"  {signed.number}. {signoff.time}: {signoff.signer} ({signoff.role}) signed {covered}; {eyes}")
    if signoff.comment:
        print_text(f"     {signoff.comment}")
