"""The command ``identify``: a plant and a domain from logs."""

import time
from typing import Annotated

from tyro.conf import Positional, arg

from ..common.errors import SwingupError
from ..common.files import check_writable
from ..identification.identify import identify
from ..report.inputs import check_suffix
from ..report.log_report import identification_tables, report_identification
from ..report.save import PAGE_FORMATS, save_log_report
from .arguments import OptionalNames, PlantOutputs, check_plant_outputs, named_values, optional
from .output import tell, tell_json
from .progress import Progress
from .tables import show_parts

Logs = Positional[Annotated[tuple[str, ...], arg(metavar="LOG...")]]
TestLogs = Annotated[tuple[str, ...], arg(metavar="LOG...")]
KnownValues = Annotated[
    tuple[str, ...], arg(metavar="NAME=VALUE...", help="values that you know, as m2r2=0.16, Ir=6e-5 or gain=0.85.")
]
Sessions = Annotated[
    tuple[str, ...], arg(metavar="LABEL...", help="a session's label for each log, test logs last.")
]


def identify_command(
    logs: Logs,
    /,
    test: TestLogs = (),
    start: Annotated[str, arg(metavar="NAME|FILE")] = "C.1",
    out: PlantOutputs = (),
    known: KnownValues = (),
    sessions: Sessions = (),
    columns: OptionalNames = (),
    force: bool = False,
    seed: int = 0,
    page: Annotated[str | None, optional("FILE.html")] = None,
    json: bool = False,
) -> int:
    """Fit a pendulum's parameters and its loop to logs; takes a minute or less for five logs of 10 s.

    Errors are those of held-out motion: the test logs, or without them a part of the logs.

    Args:
        logs: logs to fit.
        test: logs to report errors on; not fitted.
        start: plant to start from, which knows the lengths: a shipped plant's name or a file.
        out: files for the plant, .yml, .urdf or .xml; its ranges go to FILE-domain.yml beside the first.
        known: values that you know.
        sessions: labels, where offsets, torque gain and delay differ between logs.
        columns: names and units of the logs' columns, as time=t:ms q1=theta1:deg u1=current1:A*0.7 q2=b-a, or names
            in order, with _ for a column that is not read.
        force: take logs as they are that look wrong.
        seed: seed of the intervals' bootstrap.
        page: page (.html) or figure (.png, .svg, .pdf): windows, residuals, friction curves and held-out errors.
        json: print one JSON object.
    """
    if not logs:
        raise SwingupError("swingup identify needs LOG...: see swingup identify --help")
    check_plant_outputs(out)
    if page is not None:
        check_suffix(page, PAGE_FORMATS)
        check_writable(page)
    begun, log = time.monotonic(), Progress().log
    facts = named_values("--known", known, "m2r2=0.16")
    found = identify(logs, test, start, facts, sessions or None, seed, columns, force)
    log(f"fitted in {time.monotonic() - begun:.0f} s")
    if json:
        # Standard output holds one object; what logs showed is said beside it.
        for warning in (text for recording in found.recordings for text in recording.warnings):
            log(warning)
        tell_json(found.as_dict())
    else:
        show_parts(identification_tables(found), found.notes)
    if page is not None:
        save_log_report(report_identification(found), page)
    if out:
        domain = found.save(*out)
        if not json:
            command = f"swingup evaluate ROBOT --board sim2real --domain {domain}"
            tell("", f"wrote {', '.join(out)} and {domain}: try a controller with {command}")
    return 0
