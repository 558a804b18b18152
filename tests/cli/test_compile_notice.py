"""What people see when something has to be compiled."""

import io
import time

import pytest
from rich.console import Console

from dctorque_can.cli import compile_notice, console
from dctorque_can.cli.compile_notice import CompileNotice
from dctorque_can.compiling import watch


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch):
    """Put another console in the place of stderr; give what was written there."""

    def on(terminal: bool) -> io.StringIO:
        written = io.StringIO()
        shown = Console(file=written, force_terminal=terminal, width=200, highlight=False, soft_wrap=True)
        for module in (console, compile_notice):
            monkeypatch.setattr(module, "STDERR", shown)
        return written

    monkeypatch.setattr(watch, "so_far", watch.Compiled())
    return on


def compile_two(failed: bool = False) -> None:
    """Do what numba does for a function that calls another."""
    watch.begins()
    watch.begins()
    time.sleep(0.15)  # so that a terminal is drawn anew
    watch.ends(failed=False)
    watch.ends(failed=failed)


def test_elsewhere_a_line_at_the_start_and_one_at_the_end(seen, tmp_path) -> None:
    written = seen(terminal=False)
    notice = CompileNotice()
    with watch.telling(notice):
        compile_two()
        assert written.getvalue() == "compiling for this machine, once (`dctorque warm-up` does so beforehand)\n"
        compile_two()
    watch.so_far.folders.add(tmp_path)
    notice.finish()
    assert written.getvalue().splitlines()[1:] == [f"compiled 4 functions in 0 s; they are kept in {tmp_path}"]
    notice.finish()
    assert len(written.getvalue().splitlines()) == 2  # nothing new, nothing said


def test_on_a_terminal_a_figure_that_runs(seen) -> None:
    written = seen(terminal=True)
    with watch.telling(CompileNotice()), console.activity("preparing"):
        time.sleep(0.2)
        compile_two()
    assert "preparing" in written.getvalue()
    assert "(compiling for this machine, once: 0 functions, 0 s so far)" in written.getvalue()


def test_a_terminal_that_shows_nothing_gets_a_line_of_its_own(seen) -> None:
    written = seen(terminal=True)
    with watch.telling(CompileNotice()):
        compile_two()
    assert "compiling for this machine, once: 0 functions" in written.getvalue()


def test_a_function_that_fails_is_not_counted(seen) -> None:
    seen(terminal=False)
    compile_two(failed=True)
    assert watch.so_far.functions == 1


def test_code_that_no_file_keeps_says_so(seen) -> None:
    written = seen(terminal=False)
    notice = CompileNotice()
    with watch.telling(notice):
        compile_two()
    notice.finish()
    assert "they are kept in no file" in written.getvalue()


def test_a_problem_is_a_warning_once(seen) -> None:
    written = seen(terminal=False)
    with watch.telling(CompileNotice()):
        watch.problem("there is no place for this test")
        watch.problem("there is no place for this test")
    assert written.getvalue() == "warning: there is no place for this test\n"


def test_nothing_compiled_says_nothing(seen) -> None:
    written = seen(terminal=False)
    CompileNotice().finish()
    assert written.getvalue() == ""
