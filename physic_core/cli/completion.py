"""The command ``physic completion``: completion scripts that hold every command and option, and start no program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import click

from physic_core.cli.output import echo

__all__ = ["CommandWords", "command_words", "completion", "completion_script"]


@dataclass(frozen=True)
class CommandWords:
    """What can follow one command.

    Attributes:
        path: the words that call the command, "physic config check".
        commands: name -> summary of each command in the group.
        options: spelling -> help of each option.
        values: spelling -> what can follow it; empty for an option whose value is not one of a list (a file, a number).
            A flag is not in it.
    """

    path: str
    commands: dict[str, str]
    options: dict[str, str]
    values: dict[str, tuple[str, ...]]


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print a completion script for SHELL.

    The script holds the commands and options of everything that is installed now; write it again after you install a
    plugin that adds a command.
    """
    root = ctx.find_root()
    echo(completion_script(shell, command_words(root.command, root)), nl=False)


def command_words(command: click.Command, ctx: click.Context, path: str = "physic") -> list[CommandWords]:
    """Return the words of a command and of all commands below it, without hidden and broken ones."""
    shown = [one for one in command.get_params(ctx) if isinstance(one, click.Option) and not one.hidden]
    options = {
        spelling: (one.help or "").split("\n")[0] for one in shown for spelling in (*one.opts, *one.secondary_opts)
    }
    values = {
        spelling: _choices(spelling, one) for one in shown if not one.is_flag and not one.count for spelling in one.opts
    }
    below = dict(_commands(command, ctx)) if isinstance(command, click.Group) else {}
    summaries = {name: inner.get_short_help_str(80) for name, inner in below.items()}
    found = [CommandWords(path, summaries, options, values)]
    for name, inner in below.items():
        found += command_words(inner, click.Context(inner, parent=ctx, **inner.context_settings), f"{path} {name}")
    return found


def completion_script(shell: str, words: list[CommandWords]) -> str:
    """Return the script for "bash", "zsh" or "fish"."""
    return {"bash": _bash, "zsh": _zsh, "fish": _fish}[shell](words)


def _commands(group: click.Group, ctx: click.Context) -> Iterator[tuple[str, click.Command]]:
    from physic_core.errors import PluginError

    for name in group.list_commands(ctx):
        try:
            command = group.get_command(ctx, name)
        except PluginError:
            continue  # "physic plugins doctor" reports it
        if command is not None and not command.hidden:
            yield name, command


def _choices(spelling: str, option: click.Option) -> tuple[str, ...]:
    if spelling == "--preset" and not isinstance(option.type, click.Choice):
        from physic_core.configuration.model import preset_names

        return tuple(preset_names())
    return tuple(map(str, getattr(option.type, "choices", ())))


def _quote(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


def _cases(words: list[CommandWords]) -> tuple[str, str, str]:
    """Return the arms of three ``case`` statements that bash and zsh share: paths, values of options, words."""
    paths = "|".join(_quote(one.path) for one in words[1:])
    values = [
        f"    {_quote(f'{one.path} {spelling}')}) values={_quote(' '.join(choices))}; takes_value=1 ;;"
        for one in words
        for spelling, choices in one.values.items()
    ]
    arms = [
        f"    {_quote(one.path)}) commands={_quote(' '.join(one.commands))}; options={_quote(' '.join(one.options))} ;;"
        for one in words
    ]
    return paths, "\n".join(values), "\n".join(arms)


def _bash(words: list[CommandWords]) -> str:
    paths, values, arms = _cases(words)
    return f"""# Completion of physic for bash, written by: physic completion bash
_physic() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} called=physic i commands options values takes_value=
  for ((i = 1; i < COMP_CWORD; i++)); do
    case "$called ${{COMP_WORDS[i]}}" in
    {paths}) called="$called ${{COMP_WORDS[i]}}" ;;
    esac
  done
  case "$called" in
{arms}
  esac
  case "$called ${{COMP_WORDS[COMP_CWORD-1]}}" in
{values}
  esac
  COMPREPLY=()
  if [[ $takes_value ]]; then
    COMPREPLY=($(compgen -W "$values" -- "$current"))
  elif [[ $current == -* ]]; then
    COMPREPLY=($(compgen -W "$options" -- "$current"))
  else
    COMPREPLY=($(compgen -W "$commands" -- "$current"))
  fi
}}
complete -o default -F _physic physic
"""


def _zsh(words: list[CommandWords]) -> str:
    paths, values, arms = _cases(words)
    return f"""#compdef physic
# Completion of physic for zsh, written by: physic completion zsh
_physic() {{
  local current=$words[CURRENT] called=physic i commands options values takes_value=
  for ((i = 2; i < CURRENT; i++)); do
    case "$called $words[i]" in
    ({paths}) called="$called $words[i]" ;;
    esac
  done
  case "$called" in
{arms}
  esac
  case "$called $words[CURRENT-1]" in
{values}
  esac
  if [[ -n $takes_value ]]; then
    if [[ -n $values ]]; then compadd -- ${{=values}}; else _files; fi
  elif [[ $current == -* ]]; then
    compadd -- ${{=options}}
  elif [[ -n $commands ]]; then
    compadd -- ${{=commands}}
  else
    _files
  fi
}}
if [[ $funcstack[1] == _physic ]]; then _physic "$@"; else compdef _physic physic; fi
"""


def _fish(words: list[CommandWords]) -> str:
    lines = [
        "# Completion of physic for fish, written by: physic completion fish",
        "function __physic_at",
        "    set -l called physic",
        "    for word in (commandline -opc)[2..]",
        '        switch "$called $word"',
        f"            case {' '.join(_quote(one.path) for one in words[1:])}",
        '                set called "$called $word"',
        "        end",
        "    end",
        '    test "$called" = "$argv"',
        "end",
    ]
    for one in words:
        at = f"complete -c physic -n {_quote(f'__physic_at {one.path}')}"
        lines += [f"{at} -f -a {name} -d {_fish_quote(text)}" for name, text in one.commands.items()]
        for spelling, text in one.options.items():
            flag = f"-l {spelling[2:]}" if spelling.startswith("--") else f"-s {spelling[1:]}"
            choices = one.values.get(spelling)
            value = "" if choices is None else f" -x -a {_quote(' '.join(choices))}" if choices else " -r"
            lines.append(f"{at} {flag}{value} -d {_fish_quote(text)}")
    return "\n".join(lines) + "\n"


def _fish_quote(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
