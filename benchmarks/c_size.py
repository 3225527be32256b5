"""Flash and RAM of C headers: `size` on x86-64, Cortex-M4 and AVR, and the self-tests in emulators.

    .venv/bin/python benchmarks/c_size.py

Compilers and emulators that are not installed are left out: gcc; gcc-arm-none-eabi, libnewlib-arm-none-eabi and
qemu-user; gcc-avr, avr-libc and simavr (Debian's packages).
"""

import itertools
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swingup.controllers.baselines.baselines import feedback_policy
from swingup.export.c_header import c_header
from swingup.export.c_text import Precision
from swingup.policy.feedback import RobotPolicy
from swingup.policy.network import Layer, Network, NormaliseStage
from swingup.policy.policy import TaskPolicy, task_metadata
from swingup.policy.shipped import load_policy
from swingup.policy.spaces import box


class Board(NamedTuple):
    """A processor: how to compile for it, and how to run a program in an emulator."""

    compiler: tuple[str, ...]
    size: str
    precisions: tuple[Precision, ...]
    emulator: tuple[str, ...] = ()
    start: str = ""  # C around ``main``
    report: str = "return result;"  # How a program says its result


ARM_START = """
__attribute__((naked)) void _start(void)
{
    __asm__("bl main\\n mov r7, #1\\n svc #0"); /* ends the emulator's process with the result */
}
"""
AVR_REPORT = """
UCSR0B = 1 << TXEN0;
UDR0 = (unsigned char)('0' + result);
while (!(UCSR0A & (1 << UDRE0))) {}
UDR0 = 10;
while (!(UCSR0A & (1 << TXC0))) {}
cli();
sleep_enable();
sleep_cpu();
"""
TOO_LARGE = "overflowed|too large|will not fit|64 kB|size of (array|variable)"
M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-nostartfiles", "--specs=nosys.specs")
AVR = ("-mmcu=atmega2560", "-include", "avr/io.h", "-include", "avr/sleep.h", "-include", "avr/interrupt.h")
BOARDS = {
    "x86-64": Board(("gcc",), "size", ("double", "single")),
    "Cortex-M4": Board(
        ("arm-none-eabi-gcc", *M4),
        "arm-none-eabi-size",
        ("double", "single"),
        ("qemu-arm", "-cpu", "max"),
        ARM_START,
    ),
    "ATmega2560": Board(
        ("avr-gcc", *AVR),
        "avr-size",
        ("single",),
        ("simavr", "-m", "atmega2560", "-f", "16000000"),
        report=AVR_REPORT,
    ),
}

TASK = """
#include "policy.h"
static double observation[SWINGUP_INPUTS];
static SWINGUP_ACTION action[SWINGUP_ACTIONS];
static int act(void)
{
    return swingup_policy(observation, action);
}
#define self_test() swingup_self_test()
"""
PENDULUM = """
#include "policy.h"
static double x[4], u[2];
static swingup_controller controller;
static int act(void)
{
    swingup_reset(&controller);
    swingup_control(&controller, 0.0, x, u);
    return u[0] > 0;
}
#define self_test() swingup_self_test(&controller)
"""


def small_policy(widths: tuple[int, ...]) -> TaskPolicy:
    """An untrained policy with hidden layers of these widths, of three observations and one action."""
    rng, sizes = np.random.default_rng(0), (3, *widths, 1)
    layers = [
        Layer(rng.normal(size=(n, m)).astype(np.float32) / np.float32(m**0.5), np.zeros(n, np.float32))
        for m, n in itertools.pairwise(sizes)
    ]
    network = Network((NormaliseStage(np.zeros(3), np.ones(3)),), tuple(layers[:-1]), layers[-1], activation="tanh")
    return TaskPolicy(network, task_metadata("a task", box((3,)), box((1,), -2.0, 2.0), 0.05))


def measure(board: Board, policy: TaskPolicy | RobotPolicy, precision: Precision) -> tuple[int, int, str]:
    """Flash and RAM (bytes) that a policy adds to an empty program, and what its self-test says in the emulator."""
    number = "double" if precision == "double" else "float"
    whole = (TASK if isinstance(policy, TaskPolicy) else PENDULUM).replace("double", number)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "policy.h").write_text(c_header(policy, precision=precision))

        def build(text: str, call: str) -> tuple[int, int]:
            main = f"int main(void) {{ volatile int result = {call}; {board.report} return 0; }}"
            (folder / "main.c").write_text(f"{text}\n{main}\n{board.start}")
            options = ["-std=c99", "-Os", "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections"]
            options += ["main.c", "-o", "main", "-lm"]
            subprocess.run([*board.compiler, *options], cwd=folder, check=True, capture_output=True, text=True)
            sizes = subprocess.run([board.size, "main"], cwd=folder, check=True, capture_output=True, text=True)
            text_size, data, bss = map(int, sizes.stdout.splitlines()[1].split()[:3])
            return text_size + data, data + bss

        flash, ram = np.subtract(build(whole, "act()"), build("", "0")).tolist()
        build(whole, "self_test()")
        command = [*board.emulator, "./main"]
        if board.emulator and shutil.which(command[0]) is None:
            return flash, ram, "-"
        run = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
        printed = re.search(r"(\d)\.", run.stdout) if board.report == AVR_REPORT else None
        return flash, ram, printed[1] if printed else str(run.returncode)


def main() -> None:
    """Print the table."""
    policies: dict[str, TaskPolicy | RobotPolicy] = {
        "a task, 16 and 16 tanh": small_policy((16, 16)),
        "a task, 64 and 64 tanh": small_policy((64, 64)),
        "`lqr`": feedback_policy("lqr", "acrobot"),
        "`ar-eapo`": load_policy("ar-eapo", "acrobot"),
        "`adaptive`": load_policy("adaptive", "acrobot"),
    }
    print("| policy | processor | precision | flash (B) | RAM (B) | self-test |\n|---|---|---|---:|---:|---|")
    for name, policy in policies.items():
        for processor, board in BOARDS.items():
            if shutil.which(board.compiler[0]) is None:
                continue
            for precision in board.precisions:
                try:
                    flash, ram, test = measure(board, policy, precision)
                    row = f"{flash:,} | {ram:,} | {test}"
                except subprocess.CalledProcessError as error:
                    if not re.search(TOO_LARGE, error.stderr):
                        raise
                    row = "too large | | "
                print(f"| {name} | {processor} | {precision} | {row} |", flush=True)


if __name__ == "__main__":
    main()
