"""The boards' columns: their units, and how the paper prints them."""

from dataclasses import dataclass

PERFORMANCE = ("swingup_time", "energy", "torque_cost", "torque_smoothness", "velocity_cost", "score")
"""Columns of a board of swing-ups in a perfect loop."""


@dataclass(frozen=True)
class Column:
    """One criterion or score."""

    label: str
    heading: str
    """The label in short lines, for narrow tables."""
    unit: str
    """As the paper prints it; none for scores."""
    form: str
    """Format of its numbers."""

    @property
    def title(self) -> str:
        """The label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def show(self, value: float | None) -> str:
        """A value as the paper prints it; a dash where there is nothing to measure."""
        return "–" if value is None else format(value, self.form)


COLUMNS = {
    "swingup_time": Column("Swing-up time", "Time\n[s]", "s", ".2f"),
    "energy": Column("Energy", "Energy\n[J]", "J", ".2f"),
    # Units as printed. By their definitions the torque cost is in N² m² s, the velocity cost in rad²/s.
    "torque_cost": Column("Torque cost", "Torque\ncost", "N²m²", ".2f"),
    "torque_smoothness": Column("Torque smoothness", "Smooth-\nness", "Nm", ".4f"),
    "velocity_cost": Column("Velocity cost", "Velocity\ncost", "m²/s²", ".2f"),
    "score": Column("Score", "Score", "", ".3f"),
    "model": Column("Model", "Model\n[%]", "%", ".1f"),
    "velocity_noise": Column("Velocity noise", "Vel.\nnoise", "%", ".1f"),
    "torque_noise": Column("Torque noise", "Torq.\nnoise", "%", ".1f"),
    "torque_response": Column("Torque step response", "Torq.\nresp.", "%", ".1f"),
    "delay": Column("Time delay", "Time\ndelay", "%", ".1f"),
    "perturbations": Column("Perturbations", "Per-\nturb.", "%", ".1f"),
    "swingups": Column("Swing-ups", "Swing-\nups", "%", ".0f"),
    "best": Column("Best score", "Best\nscore", "", ".3f"),
}
