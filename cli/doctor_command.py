"""``surefoot doctor``: whether this machine is fit for a run."""

from __future__ import annotations

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode


def doctor(as_json: options.JsonOption = False) -> None:
    """Check this machine, and say what to do; plain text to paste into a question.

    Exits with 3 when something would stop a run. Takes a few seconds.
    """
    from surefoot.cli.console import print_json, print_text
    from surefoot.cli.doctor_report import Severity, examine

    findings = []
    for finding in examine():
        findings.append(finding)
        if not as_json:
            print_text(f"{finding.verdict:<5} {finding.name}: {finding.got}")
            if finding.advice:
                print_text(f"      -> {finding.advice}")
    stopped = sum(finding.verdict is Severity.FAIL for finding in findings)
    warned = sum(finding.verdict is Severity.WARN for finding in findings)
    if as_json:
        print_json(findings)
    elif stopped:
        print_text(f"{stopped} would stop a run, {warned} to look at")
    else:
        print_text(f"nothing would stop a run, {warned} to look at")
    if stopped:
        raise typer.Exit(ExitCode.ENVIRONMENT)
