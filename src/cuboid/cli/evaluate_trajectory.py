"""`cuboid evaluate trajectory`: compare an estimated camera path with the true one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.parser import seconds
from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console, new_table

if TYPE_CHECKING:
    from cuboid.lab.evaluation.trajectory import Errors, TrajectoryErrors

EXAMPLE = "cuboid evaluate trajectory DIR RECORDING"

FORMS = "trajectory.txt or another file in the TUM format, a .pose file, a result folder, or a recording with poses"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", type=Path, metavar="ESTIMATE", help=FORMS)
    parser.add_argument("truth", type=Path, metavar="TRUTH", help="the true path, in one of the same forms")
    parser.add_argument(
        "--within",
        type=seconds,
        default=0.02,
        metavar="SECONDS",
        help="largest time difference of two poses that are compared (default: %(default)s)",
    )
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw both paths and their distance into a .png or .svg file"
    )
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Compare, draw and print."""
    from cuboid.lab.evaluation.trajectory import evaluate_trajectory
    from cuboid.lab.evaluation.trajectory_plot import plot, refuse_other_forms

    if args.plot is not None:
        refuse_other_forms(args.plot)
    found = evaluate_trajectory(args.estimate, args.truth, limit_s=args.within)
    if args.plot is not None:
        plot(found, args.plot)

    def show() -> None:
        _print(found)
        if args.plot is not None:
            console().print(f"plot in {args.plot}")

    give(args, found.to_dict(), show)
    return 0


def _print(found: TrajectoryErrors) -> None:
    out = console()
    out.print(f"{found.estimate} against {found.truth}")
    out.print(
        f"{found.pairs} pairs of {found.estimate_poses} estimated and {found.truth_poses} true poses, at most "
        f"{found.limit_s:g} s apart; {100 * found.coverage:.1f} % of the truth estimated; "
        f"{found.length_m:.2f} m in {found.duration_s:.1f} s"
    )
    table = new_table("", "RMSE", "mean", "median", "max")
    table.add_row("ATE, cm", *_cells(found.ate_cm))
    for drift, unit in ((found.per_second, "s"), (found.per_metre, "m")):
        table.add_row(f"RPE, cm/{unit}", *_cells(drift.translation_cm))
        table.add_row(f"RPE, degrees/{unit}", *_cells(drift.rotation_deg))
    out.print(table)


def _cells(errors: Errors | None) -> list[str]:
    if errors is None:
        return ["-"] * 4
    return [f"{value:.3f}" for value in (errors.rmse, errors.mean, errors.median, errors.max)]
