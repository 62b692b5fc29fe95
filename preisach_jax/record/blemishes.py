"""What is missing in a record, and which samples are not used, in words."""

from __future__ import annotations

from preisach_jax.quantity import quantity
from preisach_jax.record.samples import Samples


def holes(record: Samples) -> list[str]:
    """What is missing in a record, in words: stretches of time, and outputs."""
    found: list[str] = []
    if record.gaps:
        row, seconds = max(record.gaps, key=lambda gap: gap[1])
        others = f", and {len(record.gaps) - 1} shorter ones" if len(record.gaps) > 1 else ""
        found.append(f"a gap of {quantity(seconds, 's', 3)} before sample {row + 1:,}{others}")
    if unmeasured := int((~record.measured).sum()) - left_out(record):
        found.append(f"{unmeasured:,} samples without a measured output: history of the input only")
    if record.torn_row is not None:
        found.append(torn_line(record))
    return [*found, *fault_lines(record)]


def torn_line(record: Samples) -> str:
    """Which row was left out because the file ends within it, in words."""
    return f"row {record.torn_row:,} was left out: the file ends within it"


def left_out(record: Samples) -> int:
    """How many outputs were measured and are not used."""
    return len(record.spikes) + sum(stop - start for _, start, stop in record.faults)


OF_FAULTS = {
    "stuck": "the output keeps one value while the input moves on",
    "clipped": "the output is at the end of its sensor's range",
    "wrapped": "the output's counter has wrapped",
}


def fault_lines(record: Samples) -> list[str]:
    """Which samples were not used as they are, and why: faults, spikes and jumps, in words."""
    found: list[str] = []
    for kind, words in OF_FAULTS.items():
        rows = [(start, stop) for each, start, stop in record.faults if each == kind]
        if not rows:
            continue
        count = sum(stop - start for start, stop in rows)
        some = ", ".join(_place(record, start, stop) for start, stop in rows[:3])
        others = f" and {len(rows) - 3:,} other stretches" if len(rows) > 3 else ""
        found.append(
            f"{words} in {count:,} samples ({100 * count / len(record.time):.2g} %), which were "
            f"left out: samples {some}{others}"
        )
    for what, spikes, done in (
        ("output", record.spikes, "left out"),
        (
            "input",
            record.input_spikes,
            "replaced by straight lines, as the output does not respond",
        ),
    ):
        if not spikes:
            continue
        rows = sorted(spikes)
        many = len(rows) > 1
        some = ", ".join(_place(record, row) for row in rows[:3])
        others = f" and {len(rows) - 3:,} others" if len(rows) > 3 else ""
        share = 100 * len(rows) / len(record.time)
        found.append(
            f"{len(rows):,} {what}{'s' * many} ({share:.2g} %) "
            f"{'stand out from their' if many else 'stands out from its'} neighbours and "
            f"{'were' if many else 'was'} {done}: sample{'s' * many} {some}{others}"
        )
    return found + _jump_lines(record)


def _jump_lines(record: Samples) -> list[str]:
    """Which jumps of the output were taken back, in words."""
    if not record.jumps:
        return []
    unit, jumps = record.output_unit, record.jumps
    greatest = sorted(jumps, key=lambda row: -abs(jumps[row].height))[:3]
    some = ", ".join(
        f"by {quantity(jumps[row].height, unit, 2)} at sample {_place(record, row)}"
        for row in sorted(greatest)
    )
    others = f" and {len(jumps) - 3:,} smaller ones" if len(jumps) > 3 else ""
    many = len(jumps) > 1
    return [
        f"the output jumps {f'{len(jumps):,} times' if many else 'once'} from one sample to the "
        f"next and stays off, as by a sensor that slips or a load put on: {some}{others}; "
        f"{'these jumps were' if many else 'this jump was'} taken back"
    ]


def _place(record: Samples, start: int, stop: int | None = None) -> str:
    """One row, or a stretch of them, counted from 1; of joined records within its own."""
    runs = [run for run in record.runs if start in run]
    first = runs[0].start if runs else 0
    rows = f"{start - first + 1:,}" + (f"-{stop - first:,}" if stop is not None else "")
    return f"{rows} of {runs[0].name}" if runs else rows
