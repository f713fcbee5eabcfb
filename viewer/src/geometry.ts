// Shapes of bodies and symbols as triangles, coloured per vertex so that a body is one mesh.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, ConeGeometry,
  CylinderGeometry, ExtrudeGeometry, LatheGeometry, Matrix4, Quaternion, SphereGeometry,
  Shape as Outline, TorusGeometry, TubeGeometry, Vector2, Vector3, Curve,
} from "three";
import { ConvexGeometry } from "three/examples/jsm/geometries/ConvexGeometry.js";
import { mergeGeometries, mergeVertices, toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import type { Frame, Shape, Triple } from "./data";

/** What round things are made round for: lengths are seen against this one. */
const detail = { size: 1, factor: 1 };

/** `factor` 1 is for a renderer in software; where there are many things each is seen small. */
export function setDetail(size: number, factor: number): void {
  Object.assign(detail, { size, factor });
}

/** Sides of a circle that looks round from where the whole is seen: it is off by a third of a pixel. */
function sides(radius: number, most = 32): number {
  return Math.max(6, Math.min(most, Math.ceil(110 * detail.factor * Math.sqrt(radius / detail.size))));
}

const Y = new Vector3(0, 1, 0);
const Z = new Vector3(0, 0, 1);

export const vector = (p: Triple) => new Vector3(p[0], p[1], p[2]);

/** Axis f, g or h (0, 1, 2) of a frame, body axes. */
export const axisOf = (frame: Frame, k: number) =>
  new Vector3(frame.axes[0][k], frame.axes[1][k], frame.axes[2][k]);

export const turnOf = (frame: Frame) =>
  new Quaternion().setFromRotationMatrix(
    new Matrix4().makeBasis(axisOf(frame, 0), axisOf(frame, 1), axisOf(frame, 2)),
  );

export function paint(geometry: BufferGeometry, color: Color): BufferGeometry {
  geometry.deleteAttribute("uv");
  // Corners that triangles share are lit once.
  const plain = geometry.index ? geometry : mergeVertices(geometry);
  const count = plain.getAttribute("position").count;
  const colors = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) color.toArray(colors, 3 * i);
  plain.setAttribute("color", new BufferAttribute(colors, 3));
  return plain;
}

export const merge = (parts: BufferGeometry[]) => mergeGeometries(parts, false) as BufferGeometry;

/** Moves a geometry along y so that it lies from one point to another. */
function lay(geometry: BufferGeometry, from: Vector3, to: Vector3): BufferGeometry {
  const turn = new Quaternion().setFromUnitVectors(Y, to.clone().sub(from).normalize());
  const middle = from.clone().add(to).multiplyScalar(0.5);
  return geometry.applyQuaternion(turn).translate(middle.x, middle.y, middle.z);
}

export function rod(from: Vector3, to: Vector3, radius: number): BufferGeometry {
  const length = from.distanceTo(to);
  if (length < 1e-6 * radius) return ball(from, radius);
  return lay(capsule(radius, length), from, to);
}

function capsule(radius: number, length: number): BufferGeometry {
  const count = sides(radius);
  return new CapsuleGeometry(radius, length, Math.max(2, Math.round(count / 6)), count);
}

export function cylinder(from: Vector3, to: Vector3, radius: number): BufferGeometry {
  return lay(new CylinderGeometry(radius, radius, from.distanceTo(to), sides(radius)), from, to);
}

export function ball(at: Vector3, radius: number): BufferGeometry {
  const count = sides(radius);
  return new SphereGeometry(radius, count, Math.ceil(0.6 * count)).translate(at.x, at.y, at.z);
}

export function ring(radius: number, thickness: number): BufferGeometry {
  return new TorusGeometry(radius, thickness, Math.min(8, sides(thickness)), sides(radius + thickness, 24));
}

function hull(points: Vector3[], radius: number): BufferGeometry {
  // A little body around every point gives flat sets a thickness, and blunt corners.
  const corners = points.flatMap((p) =>
    [-1, 1].flatMap((x) =>
      [-1, 1].flatMap((y) => [-1, 1].map((z) => p.clone().add(new Vector3(x, y, z).multiplyScalar(radius)))),
    ),
  );
  return new ConvexGeometry(corners);
}

function plate(points: Vector3[], thickness: number): BufferGeometry {
  const normal = points[1].clone().sub(points[0]).cross(points[2].clone().sub(points[0])).normalize();
  return new ConvexGeometry(
    points.flatMap((p) => [-0.5, 0.5].map((k) => p.clone().addScaledVector(normal, k * thickness))),
  );
}

/** The rim of a wheel; the tyre is an element of its own. */
function rim(at: Vector3, axis: Vector3, radius: number, width: number): BufferGeometry {
  const r = 0.64 * radius;
  const w = 0.4 * width;
  const profile = [
    [0, 0.3 * w], [0.22 * r, 0.3 * w], [0.26 * r, -0.1 * w], [0.82 * r, 0.15 * w], [0.86 * r, w], [r, w],
    [r, -w], [0.86 * r, -w], [0.82 * r, -0.15 * w], [0, -0.3 * w],
  ].map(([x, y]) => new Vector2(x, y));
  const turn = new Quaternion().setFromUnitVectors(Y, axis);
  return new LatheGeometry(profile.reverse(), sides(radius, 28)).applyQuaternion(turn).translate(at.x, at.y, at.z);
}

export function tyre(at: Vector3, axis: Vector3, radius: number): BufferGeometry {
  const [r, w] = [radius, 0.26 * radius];
  const profile = [
    [0.64 * r, 0.8 * w], [0.82 * r, w], [0.95 * r, 0.95 * w], [0.985 * r, 0.8 * w], [r, 0.6 * w],
    [r, -0.6 * w], [0.985 * r, -0.8 * w], [0.95 * r, -0.95 * w], [0.82 * r, -w], [0.64 * r, -0.8 * w],
  ].map(([x, y]) => new Vector2(x, y));
  const turn = new Quaternion().setFromUnitVectors(Y, axis);
  return new LatheGeometry(profile.reverse(), sides(radius)).applyQuaternion(turn).translate(at.x, at.y, at.z);
}

export function shapeGeometry(shape: Shape): BufferGeometry {
  switch (shape.type) {
    case "rod":
      return rod(vector(shape.from), vector(shape.to), shape.radius);
    case "plate":
      return plate(shape.points.map(vector), shape.thickness);
    case "hull":
      return hull(shape.points.map(vector), shape.radius);
    case "sphere":
      return placed(ball(new Vector3(), shape.radius), shape);
    case "cylinder":
      return placed(new CylinderGeometry(shape.radius, shape.radius, shape.length, sides(shape.radius)).rotateX(Math.PI / 2), shape);
    case "capsule":
      return placed(capsule(shape.radius, shape.length).rotateX(Math.PI / 2), shape);
    case "mesh":
      return placed(surfaceOf(shape.vertices, shape.faces), shape);
    case "wheel":
      return rim(vector(shape.at), vector(shape.axis).normalize(), shape.radius, shape.width);
    case "box":
      return placed(new BoxGeometry(...shape.size), shape);
  }
}

function placed(geometry: BufferGeometry, { at, axes }: { at: Triple; axes?: Triple[] }): BufferGeometry {
  if (axes) {
    const [a, b, c] = axes;
    geometry.applyMatrix4(new Matrix4().set(...a, 0, ...b, 0, ...c, 0, 0, 0, 0, 1));
  }
  return geometry.translate(...at);
}

/** Triangles with sharp edges where they meet at more than 35 degrees. */
function surfaceOf(vertices: Float32Array, faces: Uint32Array): BufferGeometry {
  const whole = new BufferGeometry();
  whole.setAttribute("position", new BufferAttribute(vertices, 3));
  whole.setIndex(new BufferAttribute(faces, 1));
  return toCreasedNormals(whole, (35 * Math.PI) / 180);
}

/** A shape as what throws its shadow: thin things need not be round. Null for what is too small to be missed. */
export function shadowGeometry(shape: Shape): BufferGeometry | null {
  const small = 0.004 * detail.size;
  switch (shape.type) {
    case "cylinder":
    case "capsule": {
      if (shape.radius < small) return null;
      const length = shape.length + (shape.type === "capsule" ? shape.radius : 0);
      const count = Math.max(5, Math.ceil(0.6 * sides(shape.radius)));
      return placed(new CylinderGeometry(shape.radius, shape.radius, length, count).rotateX(Math.PI / 2), shape);
    }
    case "rod": {
      const [from, to] = [vector(shape.from), vector(shape.to)];
      if (shape.radius < small || from.distanceTo(to) < 1e-6 * shape.radius) return null;
      return lay(new CylinderGeometry(shape.radius, shape.radius, from.distanceTo(to), 5), from, to);
    }
    case "sphere":
      return shape.radius < small ? null : placed(new SphereGeometry(shape.radius, 10, 6), shape);
    default:
      return shapeGeometry(shape);
  }
}

class Helix extends Curve<Vector3> {
  constructor(private radius: number, private turns: number) {
    super();
  }
  override getPoint(s: number, target = new Vector3()): Vector3 {
    // Straight ends on the line of the spring, coils between them.
    const u = Math.min(1, Math.max(0, (s - 0.08) / 0.84));
    const r = this.radius * Math.min(1, s / 0.06, (1 - s) / 0.06);
    const angle = 2 * Math.PI * this.turns * u;
    return target.set(r * Math.cos(angle), r * Math.sin(angle), s < 0.08 || s > 0.92 ? s : 0.08 + 0.84 * u);
  }
}

/** A coil along z of unit length; stretched by scaling, which a thin wire does not show. */
export function coil(radius: number, wire: number, length: number, turns: number): BufferGeometry {
  const count = Math.max(7, Math.min(14, sides(radius)));
  return new TubeGeometry(new Helix(radius / length, turns), count * turns, wire / length, detail.factor > 1 ? 5 : 3)
    .scale(length, length, 1);
}

/** A spiral in the plane across z. */
export function spiral(radius: number): BufferGeometry {
  class Spiral extends Curve<Vector3> {
    constructor() {
      super();
    }
    override getPoint(s: number, target = new Vector3()): Vector3 {
      const angle = 2.5 * 2 * Math.PI * s;
      const r = radius * (0.35 + 0.65 * s);
      return target.set(r * Math.cos(angle), r * Math.sin(angle), 0);
    }
  }
  return new TubeGeometry(new Spiral(), Math.ceil(2.5 * sides(radius)), 0.09 * radius, detail.factor > 1 ? 6 : 3);
}

/** An arc with a head, turning about z. */
export function roundArrow(radius: number): BufferGeometry[] {
  const arc = new TorusGeometry(radius, 0.07 * radius, 8, 40, 1.5 * Math.PI);
  // The arc ends at the angle 3π/2, at (0, −radius), on its way to +x.
  const head = new ConeGeometry(0.2 * radius, 0.5 * radius, 16).rotateZ(-Math.PI / 2);
  head.translate(0.2 * radius, -radius, 0);
  return [arc, head];
}

/** A bearing on the ground, as drawn by hand: a triangle on a hatched line, its tip at the origin. */
export function standing(size: number, planar: boolean): BufferGeometry {
  const height = 3.6 * size;
  if (!planar) return new ConeGeometry(2.1 * size, height, 4, 1).rotateY(Math.PI / 4).rotateX(Math.PI / 2).translate(0, 0, -height / 2);
  const triangle = new Outline([new Vector2(0, 0), new Vector2(-2 * size, -height), new Vector2(2 * size, -height)]);
  const parts: BufferGeometry[] = [new ExtrudeGeometry(triangle, { depth: 0.4 * size, bevelEnabled: false })];
  parts.push(new BoxGeometry(6 * size, 0.28 * size, 0.4 * size).translate(0, -height, 0.2 * size));
  for (let k = -2.5; k <= 2.5; k++) {
    const hatch = new BoxGeometry(0.2 * size, 1.3 * size, 0.4 * size).rotateZ(-0.7);
    parts.push(hatch.translate(k * size - 0.3 * size, -height - 0.55 * size, 0.2 * size));
  }
  return merge(parts.map((part) => paint(part, new Color(1, 1, 1))));
}

export const alongZ = (direction: Vector3, turn: Quaternion) =>
  turn.setFromUnitVectors(Z, direction);
