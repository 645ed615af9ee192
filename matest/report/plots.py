"""Plots of cross-sections (matplotlib, without a display)."""

from __future__ import annotations

from pathlib import Path

from matest.profiles import Comparison

# Colours that stay apart for colour-blind readers (Okabe & Ito).
COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00")
_STYLES = ("-", "--", "-.", ":")


def plot_profiles(comparison: Comparison, path: Path) -> None:
    """Brightness along the cross-section, one curve an image, as in figure 13 of Oren & Nayar 1994."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    for number, (name, profile) in enumerate(zip(comparison.names, comparison.profiles, strict=True)):
        # A dollar sign would start a formula.
        name = name.replace("$", r"\$")
        label = name if number == 0 else f"{name} (rms {comparison.rms[number]:.3g})"
        style = _STYLES[number % len(_STYLES)]
        axes.plot(comparison.distance, profile, style, color=COLOURS[number % len(COLOURS)], label=label, linewidth=1.6)
    axes.set_xlabel("distance along the cross-section (pixels)")
    axes.set_ylabel("brightness")
    axes.set_ylim(bottom=min(0.0, float(comparison.profiles.min())))
    axes.margins(x=0)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    FigureCanvasAgg(figure).print_png(path)
