"""Boards that OpenCV makes and solves itself, as files for `retina import opencv`.

    .venv/bin/pip install opencv-python-headless==5.0.0.93 numpy
    .venv/bin/python validation/opencv_boards.py OUT.yaml [--fisheye] [--views N] [--noise-px PX]

Writes the file with cv2.FileStorage (YAML or JSON by the name) and prints some directions that the solved poses give, for
comparison. The fixtures of retina-import/tests:

    validation/opencv_boards.py retina-import/tests/fixtures/rational.yaml
    validation/opencv_boards.py retina-import/tests/fixtures/fisheye.json --fisheye
"""

import argparse

import cv2
import numpy as np

arguments = argparse.ArgumentParser()
arguments.add_argument("out")
arguments.add_argument("--fisheye", action="store_true")
arguments.add_argument("--views", type=int, default=9)
arguments.add_argument("--noise-px", type=float, default=0.05)
options = arguments.parse_args()
random = np.random.default_rng(7)

size, (width, height), square = (1280, 960), (8, 6), 0.05
K = np.array([[520.0, 0.0, 642.0], [0.0, 522.0, 476.0], [0.0, 0.0, 1.0]])
D = np.array([-0.02, 0.015, -0.006, 0.001] if options.fisheye else [0.30, 0.05, 0.001, -0.002, 0.004, 0.65, 0.12, 0.01])
board = np.array([(i * square, j * square, 0.0) for j in range(height) for i in range(width)])


def project(points, turn, step):
    if options.fisheye:
        return cv2.fisheye.projectPoints(points.reshape(-1, 1, 3), turn, step, K, D)[0].reshape(-1, 2)
    return cv2.projectPoints(points, turn, step, K, D)[0].reshape(-1, 2)


views = []
while len(views) < options.views:
    turn = random.uniform(-0.6, 0.6, 3)
    step = np.array([random.uniform(-0.4, 0.2), random.uniform(-0.35, 0.1), random.uniform(0.35, 0.6)])
    seen = project(board, turn, step)
    if (seen > 5).all() and (seen < np.array(size) - 5).all():
        views.append((seen + random.normal(0.0, options.noise_px, seen.shape)).astype(np.float32))
shown = [board.astype(np.float32).reshape(-1, 1, 3)] * len(views)
pictures = [view.reshape(-1, 1, 2) for view in views]
if options.fisheye:
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    shown64, pictures64 = [s.astype(np.float64).reshape(1, -1, 3) for s in shown], [p.astype(np.float64).reshape(1, -1, 2) for p in pictures]
    rms, matrix, distortion, turns, steps = cv2.fisheye.calibrate(
        shown64, pictures64, size, K.copy(), np.zeros((4, 1)), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12),
    )
else:
    flags = cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_USE_INTRINSIC_GUESS
    rms, matrix, distortion, turns, steps = cv2.calibrateCamera(
        shown, pictures, size, K.copy(), D.copy(), flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12),
    )
    distortion = distortion.reshape(-1)[:8]
store = cv2.FileStorage(options.out, cv2.FILE_STORAGE_WRITE)
store.write("image_width", size[0])
store.write("image_height", size[1])
store.write("board_width", width)
store.write("board_height", height)
store.write("square_size", square)
store.write("fisheye_model", int(options.fisheye))
store.write("camera_matrix", matrix)
store.write("distortion_coefficients", distortion.reshape(-1, 1))
store.write("avg_reprojection_error", float(rms))
poses = np.array([np.concatenate([np.ravel(t), np.ravel(s)]) for t, s in zip(turns, steps)])
store.write("extrinsic_parameters", poses)
store.write("image_points", np.array(views))
store.release()

turn, step = poses[2, :3], poses[2, 3:]
x, y, z = cv2.Rodrigues(turn)[0] @ board[11] + step
error = np.array([np.sqrt(((project_ - view) ** 2).mean()) for project_, view in [
    ((cv2.fisheye.projectPoints(board.reshape(-1, 1, 3), p[:3], p[3:], matrix, distortion)[0] if options.fisheye
      else cv2.projectPoints(board, p[:3], p[3:], matrix, distortion)[0]).reshape(-1, 2), view) for p, view in zip(poses, views)]])
print("OpenCV", cv2.__version__, f"{np.sqrt((error**2).mean()):.5f} px rms per axis over {len(views)} views of {len(board)} corners")
print("matrix", matrix.tolist(), "distortion", np.ravel(distortion).tolist())
print(f"view 2 corner 11: line of sight [{float(x / z)}, {float(y / z)}], pixel {views[2][11].tolist()}")
