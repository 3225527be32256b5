"""Words that make no command: one line that names the value, status 2, and no file; and what the help says."""

import contextlib
import os
import re
import sys

import pytest

from swingup.areapo.config import HYPERPARAMETERS
from swingup.cli import main
from swingup.cli.commands import COMMANDS
from swingup.cli.results import WHAT_TO_TRY
from swingup.controllers.registry import BUILT_IN

TRIALS = {"preset=a:b": "'a'", "learning_rate=1e-2:1e-4": "'1e-2:1e-4'", "log_std_init=-1:3": "log_std_init = 3.0"}
ABSURD = {
    "acrobot --seeds 2147483648": "num_envs x num_steps x seeds",
    "--env CartPole-v1 --value-layers 1000000x1000000": "value_layers = 1000000 x 1000000",
    "acrobot --num-envs 2000000000 --num-steps 2000000000 --batch-size 2000000000": "num_envs x num_steps x seeds",
}
TYRO = [
    ("evaluate acrobot --sed 3", "--seed INT"),
    ("evaluate acrobot extra", "extra"),
    ("evaluate acrobot --seed x", "Error parsing --seed: invalid literal for int"),
    ("evaluate acrobot --json=yes", "yes"),
    ("evaluate", "ROBOT"),
    ("export --out x", "--to {realaigym"),
    ("train acrobot --seed", "--seed"),
    ("train acrobot --lr 3", "swingup: --lr: here it is learning_rate"),
    ("--sed evaluate", "--sed"),
]
"""What tyro refuses: misspelt or missing options, values that are missing or of another type, further words."""
NONSENSE = [
    ("", "use one of demo, evaluate"),
    ("evalute acrobot", "did you mean evaluate?"),
    *((f"plant C.1 --out{value}", "give a value, or leave the option out") for value in ("", "=", " ,")),
    # Robots, controllers, policies, plants, domains, boards.
    ("evaluate acrobat", "did you mean acrobot?"),
    ("score x.csv --robot acrobat", "'acrobat'"),
    ("evaluate acrobot --frictionless", "--frictionless needs --plant"),
    ("plant", "a plant needs m1, m2, l1, l2, tl1, tl2"),
    ("plant C.1 --inertia joint", "says how to read a URDF"),
    ("plant C.1 --set m1", "--set 'm1': write NAME=VALUE"),
    ("plant C.1 --set m1=1 m1=2", "--set gives m1 twice"),
    ("plant C.1 --out x.sdf", "x.sdf: its name must end in .yml"),
    ("evaluate acrobot --controller lqr --board icra-real --plant A.0", "give the plant as the domain"),
    ("leaderboard acrobot --board iros-real --plant A.0", "leave the plant A.0 out"),
    ("leaderboard --json --csv", "--json and --csv exclude each other"),
    # Numbers and their ranges.
    ("evaluate acrobot --board robustness --seeds 2147483648", "2147483648"),
    ("evaluate acrobot --criteria delay", "those of --board robustness"),
    # Training.
    ("train", "name a robot (acrobot, pendubot) or give --env ID"),
    ("train acrobot --learning-rate fast", "learning_rate = 'fast': use a number"),
    ("train acrobot --resume missing --out other", "--out other does not go with --resume"),
    ("train acrobot --out full", "full exists"),
    *((f"train {words}", named) for words, named in ABSURD.items()),
    ("demo --out .", ". exists: choose another --out"),
    ("sweep acrobot --seeds 2147483648", "2,147,483,648 runs"),
    ("sweep acrobot --no-pruning", "--trials"),
    ("sweep acrobot --workers 2 --scheduler tcp://x:1", "--workers 2 does not go with --scheduler"),
    ("sweep acrobot --set learning_rate=1,1 --frames 64", "once"),
    ("sweep acrobot --set learning_rate", "NAME=VALUE"),
    ("sweep acrobot --set learnig_rate=3", "learning_rate?"),
    ("sweep --env CartPole-v1 --trials 3", "what varies"),
    *((f"sweep acrobot --trials 3 --set {words}", named) for words, named in TRIALS.items()),
    ("refine acrobot --recipe magic --out x", "'magic': use one of recover, adapt"),
    ("refine acrobot --out x.txt", "x.txt: its name must end in .safetensors"),
    ("refine acrobot --seeds 5 --out x.safetensors", "--seeds is for --recipe adapt"),
    ("refine acrobot --recipe adapt --policy adaptive --plant C.0 --out x.safetensors", "sees its plant already"),
    ("export lqr --robot acrobot --to trajectory --out x", "follows a swing-up 'lqr': use one of tvlqr"),
    ("export --robot acrobot --to c --out x --seed 3", "--seed goes with --to trajectory"),
    # Files.
    ("identify", "LOG..."),
    ("export tvlqr --to c --out x", "'tvlqr' is a baseline"),
    ("export --robot acrobot --to realaigym --out full", "full is there already"),
    ("export --robot acrobot --to realaigym --out x --username a,b", "'a,b'"),
    ("export --robot acrobot --to c --out x.h --no-guard --braking 1", "leave --no-guard out"),
    ("export --robot acrobot --to onnx --out x --velocity-limit 25", "--velocity-limit is a setting of the safety"),
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
    """What a command says in one line; it leaves no file."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("precious")

    def files():
        return {path for path in tmp_path.rglob("*") if not {"cache", "__pycache__"} & {*path.parts}}

    def run(words):
        before = files()
        assert main(words) == 2
        told = capsys.readouterr()
        assert told.out == ""
        (line,) = told.err.splitlines()
        assert files() == before
        return line

    return run


@pytest.mark.parametrize(("words", "named"), TYRO)
def test_what_no_command_has_is_named_with_the_help(words, named, capsys, tmp_path):
    assert main(words.split()) == 2
    told = capsys.readouterr()
    assert named in told.err
    assert told.out == ""
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(("words", "named"), NONSENSE)
def test_nonsense_is_refused_in_one_line_that_names_it(words, named, refused):
    line = refused(words.split())
    assert line.startswith("swingup: error: ")
    assert named in line


@pytest.mark.parametrize("words", OUT)
def test_a_link_to_itself_and_a_name_of_300_letters(words, refused, tmp_path):
    (ending,) = [suffix for end, suffix in ENDINGS.items() if words.startswith(end)] or [""]
    (tmp_path / f"loop{ending}").symlink_to(f"loop{ending}")
    for name in (f"loop{ending}", "x" * 300 + ending):
        line = refused([*words.split(), name])
        assert name[:20] in line
        assert "File exists" not in line


OF_PRESETS = "(0.0005; small: 0.001; fast: 0.0012; acrobot: 0.0006; ppo, mujoco: 0.0003)"
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
