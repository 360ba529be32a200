"""Reference pixels of OpenCV's lens models, for the tests of retina-geometry/src/lens_models.rs.

    python -m venv .venv && .venv/bin/pip install opencv-python-headless==5.0.0.93 numpy
    .venv/bin/python validation/lens_models_opencv.py

Prints the directions and where OpenCV projects them, as Rust literals. OpenCV counts pixels from the centre of the
first one; the literals are OpenCV's own numbers, without the half pixel.
"""

import cv2
import numpy as np

DIRECTIONS = [(0.1, -0.2, 1.0), (-0.7, 0.4, 1.0), (1.3, 0.9, 1.0), (2.0, -1.5, 1.0), (0.0, 0.0, 1.0)]
K = np.array([[800.0, 0.0, 640.0], [0.0, 810.0, 480.0], [0.0, 0.0, 1.0]])
FISHEYE = [-0.02, 0.015, -0.006, 0.001]
RATIONAL = [0.30, 0.05, 0.001, -0.002, 0.004, 0.65, 0.12, 0.01]


def literals(name, pixels):
    print(f"{name}:")
    for x, y in np.asarray(pixels).reshape(-1, 2):
        print(f"    [{float(x)!r}, {float(y)!r}],")


points = np.array(DIRECTIONS).reshape(-1, 1, 3)
zero = np.zeros(3)
print("OpenCV", cv2.__version__)
literals("fisheye", cv2.fisheye.projectPoints(points, zero, zero, K, np.array(FISHEYE))[0])
literals("rational", cv2.projectPoints(points, zero, zero, K, np.array(RATIONAL))[0])
literals("pinhole", cv2.projectPoints(points, zero, zero, K, None)[0])
