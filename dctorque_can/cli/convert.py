"""``dctorque convert``: the frames of a log in another format."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dctorque_can.cli.console import print_json, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import ForceOption, JsonOption

if TYPE_CHECKING:
    from dctorque_can.pipeline.frames import Frames


def convert(
    log: Annotated[Path, typer.Argument(metavar="IN", help="A log of any format that `replay` reads.")],
    output: Annotated[Path, typer.Argument(metavar="OUT", help=".mcap .blf .asc .log .trc .csv .mf4")],
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write the frames of a log to a new one; the suffixes say the formats.

    Only MCAP keeps everything. What another format cannot keep is told, with exit code 3. So is what could not be
    read.
    """
    from dctorque_can.logs.convert import Kept, write_frames
    from dctorque_can.logs.output_file import refuse_existing, remove_partial
    from dctorque_can.logs.reader import open_log
    from dctorque_can.report.traffic_lines import holds_no_frames, not_our_own, unread_topics

    refuse_existing(output, [log], force)
    with open_log(log) as reader:
        kept = Kept(output.suffix)

        def counted() -> Iterator[Frames]:
            for frames in reader.dated_frames():
                yield kept.of(frames)
                progress(reader.fraction)

        try:
            with progress_bar("converting") as progress:
                write_frames(output, counted())
        except BaseException:
            remove_partial(output)
            raise
        problems = list(reader.problems)
        lines = [*problems, *kept.lost]
        if not kept.frames:
            lines.append(holds_no_frames(str(log), reader.unread))
        for line in lines:
            warn(line)
        others = not_our_own(reader.unread)
        if kept.frames and others:
            say(unread_topics(str(log), others))
    if as_json:
        print_json({"output": str(output), "frames": kept.frames, "problems": problems, "lost": kept.lost})
    else:
        say(f"{kept.frames} frames in {output}")
    if lines:
        raise typer.Exit(ExitCode.INCOMPLETE)
