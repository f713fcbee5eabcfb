// Poses and channels between frames.

import { Quaternion, Vector3 } from "three";
import type { Body, Run } from "./data";

/** A place among the frames: the frame at or before a time, and the part of the way to the next. */
export interface Place {
  frame: number;
  part: number;
}

export function placeAt(run: Run, time: number): Place {
  const { times } = run;
  const last = times.length - 1;
  const t = time - run.start;
  if (last <= 0 || t <= times[0]) return { frame: 0, part: 0 };
  if (t >= times[last]) return { frame: last, part: 0 };
  // Frames are even but for results without steps: the guess is nearly always right.
  let frame = Math.min(last - 1, Math.floor((t / times[last]) * last));
  while (frame > 0 && times[frame] > t) frame--;
  while (frame < last - 1 && times[frame + 1] <= t) frame++;
  const span = times[frame + 1] - times[frame];
  return { frame, part: span > 0 ? (t - times[frame]) / span : 0 };
}

const from = new Quaternion();
const to = new Quaternion();

/** Writes the pose of a body: its way by a cubic, its turn by the shortest arc at an even rate. */
export function poseAt(body: Body, place: Place, position: Vector3, turn: Quaternion): void {
  const { position: p, rotation: q, origin } = body;
  const last = p.length / 3 - 1;
  const { frame: i, part: s } = place;
  const at = (frame: number, k: number) => p[3 * Math.min(last, Math.max(0, frame)) + k];
  const way = (k: number) => {
    const [a, b, c, d] = [at(i - 1, k), at(i, k), at(i + 1, k), at(i + 2, k)];
    // The ends have no neighbours: there the slope is that of the chord.
    const m0 = i > 0 ? (c - a) / 2 : c - b;
    const m1 = i + 2 <= last ? (d - b) / 2 : c - b;
    const s2 = s * s;
    const s3 = s2 * s;
    return (
      origin[k] + b * (2 * s3 - 3 * s2 + 1) + m0 * (s3 - 2 * s2 + s) + c * (3 * s2 - 2 * s3) + m1 * (s3 - s2)
    );
  };
  if (s === 0) position.set(origin[0] + at(i, 0), origin[1] + at(i, 1), origin[2] + at(i, 2));
  else position.set(way(0), way(1), way(2));
  from.set(q[4 * i + 1], q[4 * i + 2], q[4 * i + 3], q[4 * i]).normalize();
  if (s > 0 && i < last) {
    const j = 4 * (i + 1);
    to.set(q[j + 1], q[j + 2], q[j + 3], q[j]).normalize();
    from.slerp(to, s);
  }
  turn.copy(from);
}

export function valueAt(curve: Float32Array, place: Place): number {
  const a = curve[place.frame];
  return place.part > 0 ? a + (curve[place.frame + 1] - a) * place.part : a;
}
