// The ground truth of a frame, and how it is drawn over the frame.

import { colour } from "./dom";
import type { Over } from "./picture";

type Vector = [number, number, number];

export interface Body {
  position_camera_m: Vector;
  distance_m: number;
  /** Scalar first. */
  camera_from_body: [number, number, number, number];
  sun_direction_body: Vector;
  phase_deg: number;
  center_px: [number, number];
  reference_semi_axes_m: Vector;
  limb_ellipse_px: { center_px: [number, number]; semi_axes_px: [number, number]; angle_deg: number } | null;
}

export interface Intrinsics {
  fx: number;
  fy: number;
  cx: number;
  cy: number;
}

/** What is drawn of a frame. */
export interface Drawn {
  image_px: Intrinsics;
  bodies: Record<string, Body>;
  stars: { id: string; screen_px: [number, number] }[];
}

export interface Truth extends Drawn {
  time_s: number;
  epoch_tdb: string;
  compensation: string;
  radiance_scale: number;
}

export interface Layers {
  limb: boolean;
  axes: boolean;
  terminator: boolean;
  stars: boolean;
}

function turned([w, x, y, z]: [number, number, number, number], v: Vector): Vector {
  const t: Vector = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
  return [v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2], v[2] + w * t[2] + x * t[1] - y * t[0]];
}

const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Where a point of a body (its axes, m) is in the undistorted image; null behind the camera. */
function project(truth: Drawn, body: Body, at: Vector): [number, number] | null {
  const p = turned(body.camera_from_body, at);
  const [x, y, z] = [0, 1, 2].map((k) => (p[k] as number) + (body.position_camera_m[k] as number)) as Vector;
  const { fx, fy, cx, cy } = truth.image_px;
  return z > 0 ? [cx + (fx * x) / z, cy + (fy * y) / z] : null;
}

/** Points of the reference ellipsoid where the Sun is on the horizon, those that the camera sees. */
function terminator(truth: Drawn, body: Body): ([number, number] | null)[] {
  const axes = body.reference_semi_axes_m;
  // On the unit sphere u the ellipsoid's normal is u / axes: the Sun is on its horizon where u . (s / axes) = 0.
  const s = body.sun_direction_body.map((v, k) => v / (axes[k] as number)) as Vector;
  const length = Math.hypot(...s);
  const n = s.map((v) => v / length) as Vector;
  const other: Vector = Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (v: Vector): Vector => v.map((c) => c / Math.hypot(...v)) as Vector;
  const e1 = unit(cross(n, other));
  const e2 = cross(n, e1);
  const [w, x, y, z] = body.camera_from_body;
  const camera = turned([w, -x, -y, -z], body.position_camera_m.map((v) => -v) as Vector);
  const out: ([number, number] | null)[] = [];
  for (let k = 0; k <= 180; k++) {
    const [c, q] = [Math.cos((k * Math.PI) / 90), Math.sin((k * Math.PI) / 90)];
    const u = e1.map((v, i) => v * c + (e2[i] as number) * q) as Vector;
    const point = u.map((v, i) => v * (axes[i] as number)) as Vector;
    const normal = u.map((v, i) => v / (axes[i] as number)) as Vector;
    const seen = dot(normal, camera.map((v, i) => v - (point[i] as number)) as Vector) > 0;
    out.push(seen ? project(truth, body, point) : null);
  }
  return out;
}

/** What is drawn over a frame: in the undistorted image, where the truth is given. */
export function drawTruth(truth: Drawn, layers: Layers): Over {
  return (c, to, scale) => {
    c.lineWidth = 1.5;
    c.font = "12px system-ui, sans-serif";
    c.textBaseline = "middle";
    c.textAlign = "left";
    const line = (points: ([number, number] | null)[], stroke: string): void => {
      c.strokeStyle = stroke;
      c.beginPath();
      let pen = false;
      for (const point of points) {
        if (point) {
          const [x, y] = to(...point);
          if (pen) c.lineTo(x, y);
          else c.moveTo(x, y);
        }
        pen = point !== null;
      }
      c.stroke();
    };
    const label = (text: string, x: number, y: number, fill: string): void => {
      c.lineWidth = 3;
      c.strokeStyle = "rgba(0, 0, 0, 0.75)";
      c.strokeText(text, x, y);
      c.fillStyle = fill;
      c.fillText(text, x, y);
      c.lineWidth = 1.5;
    };
    const [limb, axis, sun, star] = [colour("over-limb"), colour("over-axis"), colour("over-sun"), colour("over-star")];
    for (const [name, body] of Object.entries(truth.bodies)) {
      const ellipse = body.limb_ellipse_px;
      if (layers.limb && ellipse) {
        const [x, y] = to(...ellipse.center_px);
        const [a, b] = ellipse.semi_axes_px;
        c.strokeStyle = limb;
        c.setLineDash([6, 4]);
        c.beginPath();
        c.ellipse(x, y, a * scale, b * scale, (ellipse.angle_deg * Math.PI) / 180, 0, 2 * Math.PI);
        c.stroke();
        c.setLineDash([]);
        label(name, x + 0.72 * a * scale + 4, y - 0.72 * a * scale - 4, limb);
      }
      if (layers.terminator) {
        line(terminator(truth, body), sun);
      }
      if (layers.axes) {
        const axes = body.reference_semi_axes_m;
        for (const [k, text] of ["x", "y", "north"].entries()) {
          const tip = [0, 0, 0].map((_, i) => (i === k ? 1.35 * (axes[i] as number) : 0)) as Vector;
          const end = project(truth, body, tip);
          line([body.center_px, end], axis);
          if (end) {
            const [x, y] = to(...end);
            label(text, x + 5, y, axis);
          }
        }
      }
    }
    if (layers.stars) {
      for (const { id, screen_px } of truth.stars) {
        const [x, y] = to(...screen_px);
        c.strokeStyle = star;
        c.beginPath();
        c.arc(x, y, 8, 0, 2 * Math.PI);
        c.stroke();
        label(id, x + 11, y, star);
      }
    }
  };
}
