"""Two lone objects (x, y, reflectivity), and places from where they are heard."""

OBJECTS = ((1.525, 0.425, 0.6), (1.775, -0.325, 0.4))
VIEWS = [
    {"x_m": x, "y_m": y, "yaw_rad": yaw}
    for x, y, yaw in [
        (0.0, 0.0, 0.0), (0.3, 0.9, -0.5), (0.2, -1.0, 0.6), (1.6, 1.7, -1.6), (1.5, -1.9, 1.5),
        (3.2, 0.3, 3.0), (2.9, -0.9, 2.6), (0.5, 0.4, -0.2), (2.9, 1.1, -2.5), (0.1, -0.4, 0.2),
    ]
]  # fmt: skip
