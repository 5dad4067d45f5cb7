"""What users see cannot control their terminal."""

from __future__ import annotations


def test_a_warning_cannot_control_a_terminal(python):
    """In a process of its own: where pytest has handlers of logs, warnings are left to them."""
    code = (
        "import warnings; from physic_core.cli.output import printed_logs\n"
        "with printed_logs(): warnings.warn('a\\x1b[2Jb')"
    )
    shown = python(code, PYTHONWARNINGS="always").stderr
    assert shown == "<string>:2: UserWarning: a\\x1b[2Jb\n"
