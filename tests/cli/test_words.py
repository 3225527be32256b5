"""Words that make no command: the value is named, status 2, and no file; and what the help says."""

import contextlib
import os
import re
import shlex
import sys

import pytest

from swingup.areapo.config import HYPERPARAMETERS
from swingup.cli import commands, main
from swingup.cli.arguments import split_commas
from swingup.cli.commands import COMMANDS, NARROWEST, gathered
from swingup.cli.results import WHAT_TO_TRY
from swingup.controllers.registry import BUILT_IN

NONSENSE = [
    ("", "use one of demo, evaluate"),
    ("evalute acrobot", "did you mean evaluate?"),
    ("plant C.1 --out=", "give a value, or leave the option out"),
    # What tyro refuses, with the help: misspelt options, values of another type, further words.
    ("evaluate acrobot --sed 3", "--seed INT"),
    ("evaluate acrobot extra", "extra"),
    ("evaluate acrobot --seed x", "Error parsing --seed: invalid literal for int"),
    ("train acrobot --lr 3", "swingup: --lr: here it is learning_rate"),
    # Robots, plants, domains, boards.
    ("evaluate acrobat", "did you mean acrobot?"),
    ("evaluate acrobot --frictionless", "--frictionless needs --plant"),
    ("plant", "a plant needs m1, m2, l1, l2, tl1, tl2"),
    ("plant C.1 --set m1=1 m1=2", "--set gives m1 twice"),
    ("evaluate acrobot --controller lqr --board icra-real --plant A.0", "give the plant as the domain"),
    ("leaderboard acrobot --board iros-real --plant A.0", "leave the plant A.0 out"),
    ("leaderboard --json --csv", "--json and --csv exclude each other"),
    ("evaluate acrobot --board robustness --seeds 2147483648", "2147483648"),
    ("evaluate acrobot --criteria delay", "those of --board robustness"),
    ("evaluate acrobot --check --json", "--json does not go with --check"),
    ("evaluate acrobot --check --velocity-noise 3", "--velocity-noise does not go with --check"),
    ("leaderboard --page x.png", "x.png: its name must end in .html"),
    # Training.
    ("train", "name a robot (acrobot, pendubot) or give --env ID"),
    ("train acrobot --learning-rate fast", "learning_rate = 'fast': use a number"),
    ("train acrobot --resume missing --out other", "--out other does not go with --resume"),
    ("train acrobot --out full", "full exists"),
    ("train acrobot --seeds 2147483648", "num_envs x num_steps x seeds"),
    ("train --env CartPole-v1 --value-layers 1000000x1000000", "value_layers = 1000000 x 1000000"),
    ("sweep acrobot --no-pruning", "--trials"),
    ("sweep acrobot --set learning_rate=1,1 --frames 64", "once"),
    ("sweep acrobot --set learnig_rate=3", "learning_rate?"),
    ("sweep --env CartPole-v1 --trials 3", "what varies"),
    ("sweep acrobot --trials 3 --set learning_rate=1e-2:1e-4", "'1e-2:1e-4'"),
    ("refine acrobot --recipe magic --out x", "'magic': use one of recover, adapt"),
    ("refine acrobot --out x.txt", "x.txt: its name must end in .safetensors"),
    ("refine acrobot --seeds 5 --out x.safetensors", "--seeds is for --recipe adapt"),
    # Files.
    ("export tvlqr --to c --out x", "tvlqr needs a robot"),
    ("export tvlqr --robot acrobot --plant C.0 --to realaigym --out no/such", "cannot write no/such"),
    ("export tvlqr --robot acrobot --plant C.0 --to numpy --out x", "a baseline is not written for numpy"),
    ("export ilqr-mpc --robot acrobot --to c --out x", "ilqr-mpc cannot be exported: use lqr"),
    ("export --robot acrobot --to c --out x --seed 3", "--seed goes with --to trajectory"),
    ("export tvlqr --robot acrobot --to trajectory --out t.csv --zero1 3", "--zero1 is of a controller"),
    (
        "export tvlqr --robot acrobot --plant C.0 --to realaigym --out x --username a,b",
        "'a,b' does not fit an entry",
    ),
    ("export --robot acrobot --to c --out x.h --username Ada", "--username 'Ada' is for RealAIGym's leaderboard"),
    (
        "export tvlqr --robot acrobot --to trajectory --out t.csv --name twin",
        "--name twin is of folders and C headers",
    ),
    ("identify log.csv --known", "--known has no value"),
    ("export tvlqr --robot acrobot --to trajectory --out t.csv --no-guard", "--no-guard is of a controller"),
    ("make-controller C.1 --robot acrobot --to numpy --out x", "use one of realaigym, cloudpendulum, c"),
    ("export --robot acrobot --to realaigym --out full", "full is there already"),
    ("export --robot acrobot --to realaigym --out x --username a,b", "'a,b'"),
    ("export --robot acrobot --to c --out x.h --no-guard --braking 1", "leave --no-guard out"),
]
OUT = [
    "evaluate acrobot --save", "leaderboard --page", "train acrobot --out", "train --resume",
    "refine acrobot --out", "plant C.1 --out", "excite --out", "compare log.csv --out", "rehearse",
    "plot trajectory none.csv --out", "evaluate acrobot --controller", "export --robot acrobot --to c --out",
    "export --robot acrobot --to realaigym --out", "export --robot acrobot --to cloudpendulum --out",
]  # fmt: skip

ENDINGS = {"compare": ".html", "plot": ".png", "plant": ".xml"}


@pytest.fixture
def refused(tmp_path, capsys):
    """What a command says; it leaves no file."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("precious")

    def files():
        return {path for path in tmp_path.rglob("*") if not {"cache", "__pycache__"} & {*path.parts}}

    def run(words):
        before = files()
        assert main(words) == 2
        told = capsys.readouterr()
        assert told.out == ""
        assert files() == before
        return told.err

    return run


@pytest.mark.parametrize(("words", "named"), NONSENSE)
def test_nonsense_is_named(words, named, refused):
    told = refused(words.split())
    assert named in told
    assert told.startswith("swingup: ") or "--help" in told


@pytest.mark.parametrize("words", OUT)
def test_a_link_to_itself_and_a_name_of_300_letters(words, refused, tmp_path):
    (ending,) = [suffix for end, suffix in ENDINGS.items() if words.startswith(end)] or [""]
    (tmp_path / f"loop{ending}").symlink_to(f"loop{ending}")
    for name in (f"loop{ending}", "x" * 300 + ending):
        (line,) = refused([*words.split(), name]).splitlines()
        assert name[:20] in line
        assert "File exists" not in line


OF_PRESETS = "(0.0005; small: 0.001; fast, dm-acrobot: 0.0012; ppo, episodes, continuing: 0.0003)"
NAMED = {
    "": [f"• {name} " for name in COMMANDS],
    "evaluate": BUILT_IN,
    "train": [*(f"--{name.replace('_', '-')}" for name in HYPERPARAMETERS), OF_PRESETS],
}
"""In the help: commands, controllers, and HYPERPARAMETERS, of which the rate has the values of all presets."""


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_each_help_names_what_there_is(command, capsys):
    assert main([*command.split(), "--help"]) == 0
    told = capsys.readouterr().out
    assert "None" not in told
    words = " ".join(told.replace("│", " ").split()).replace("- ", "-")
    assert [name for name in NAMED.get(command, ()) if name not in words] == []


def test_the_help_of_a_narrow_terminal_ends(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "3")
    assert main(["leaderboard", "--help"]) == 0
    # Without a minimum, tyro wraps for minutes and takes gigabytes.
    assert max(map(len, capsys.readouterr().out.splitlines())) >= NARROWEST


def test_a_platform_that_jax_lacks_is_named(monkeypatch, capsys):
    def needs(words):
        raise RuntimeError("Unable to initialize backend 'rocm': it is not known. (set JAX_PLATFORMS='')")

    monkeypatch.setattr(commands, "run_command", needs)
    assert main(["train"]) == 2
    assert "error: Unable to initialize backend 'rocm'" in capsys.readouterr().err


@pytest.mark.parametrize("advice", WHAT_TO_TRY.values())
def test_advice_names_options_that_there_are(advice, capsys):
    for command, options in re.findall(r"swingup (\w+)((?: --?[\w-]+)*)", advice):
        assert main([command, "--help"]) == 0
        assert {*options.split()} - {"adapt"} <= {*capsys.readouterr().out.split()}


FULL = "swingup: error: cannot write standard output: "


@pytest.mark.parametrize(
    ("output", "told"),
    [(None, f"{FULL}it is closed\n"), ("/dev/full", f"{FULL}No space left on device\n"), ("gone", "")],
)
def test_standard_output_that_is_closed_full_or_without_a_reader(output, told, monkeypatch, capsys):
    with contextlib.ExitStack() as stack:
        if output == "gone":
            reader, writer = os.pipe()
            os.close(reader)
            stream = stack.enter_context(open(writer, "w"))
        else:
            stream = output and stack.enter_context(open(output, "w"))
        monkeypatch.setattr(sys, "stdout", stream)
        assert main(["--help"]) == (1 if output == "gone" else 2)
    assert capsys.readouterr().err == told


def test_what_the_system_refuses_is_not_laid_to_standard_output(monkeypatch, capsys):
    def fork(*_):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(commands, "run_command", fork)
    assert main(["plant"]) == 2
    assert capsys.readouterr().err == "swingup: error: the system refused: Resource temporarily unavailable\n"


def test_commas_within_parentheses_belong_to_a_value():
    values = "q1=atan2(s,sin(c)),q2=b", "u1=clip(8*(a-b),-1,1)"
    assert split_commas(*values) == ("q1=atan2(s,sin(c))", "q2=b", "u1=clip(8*(a-b),-1,1)")


def test_values_of_an_option_that_is_given_twice_count_together():
    words = shlex.split("log.csv --known a=1 b=2 --seed 3 --known=c=4 e=6 --test x --known d=5")
    expected = "log.csv --known a=1 b=2 c=4 e=6 d=5 --seed 3 --test x"
    assert shlex.join(gathered(words, {"--known", "--test"})) == expected
    assert gathered(words, set()) == words
