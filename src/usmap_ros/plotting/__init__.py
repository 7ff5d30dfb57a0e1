"""Pictures of traces, cones and maps.

Figures are made with matplotlib's object-oriented interface: no display, no global state.  Every
function returns a `matplotlib.figure.Figure`, and `usmap_ros.plotting.style.save_figure` writes it.
"""
