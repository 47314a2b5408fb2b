"""Figures in the manner of ball-bar practice: polar plots, residuals with axis reversals, the ladder of errors.

Every figure is a :class:`matplotlib.figure.Figure` with a canvas of its own: no pyplot, no global state, no display.
matplotlib is imported when the first figure is made.
"""
