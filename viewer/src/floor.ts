// The plane under everything: a grid that fades, and the projection that throws shadows on it.

import { BufferAttribute, BufferGeometry, Color, LineBasicMaterial, LineSegments, Matrix4, Quaternion, Vector3 } from "three";
import { theme } from "./theme";

const CELLS = 22;

export class Floor {
  readonly grid: LineSegments;
  readonly cell: number;
  private turn = new Quaternion();

  constructor(planar: boolean, private up: Vector3, readonly level: number, size: number) {
    const raw = planar ? size / 5 : size / 4;
    const power = 10 ** Math.floor(Math.log10(raw));
    this.cell = power * ([1, 2, 5, 10].find((step) => step * power >= raw * 0.99) ?? 10);
    this.turn.setFromUnitVectors(new Vector3(0, 0, 1), planar ? new Vector3(0, 0, 1) : up);
    this.grid = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false }));
    this.grid.renderOrder = -4;
    this.grid.frustumCulled = false;
    this.grid.quaternion.copy(this.turn);
    this.planar = planar;
    this.paint();
  }

  private planar: boolean;

  paint(): void {
    const [places, colors]: number[][] = [[], []];
    const color = new Color(theme.now.grid);
    const strength = (x: number, y: number, main: boolean) =>
      theme.now.gridStrength * (main ? 1 : 0.5) * Math.max(0, 1 - Math.hypot(x, y) / CELLS) ** 1.5;
    const vertex = (x: number, y: number, main: boolean) => {
      places.push(x * this.cell, y * this.cell, 0);
      colors.push(color.r, color.g, color.b, strength(x, y, main));
    };
    for (let k = -CELLS; k <= CELLS; k++) {
      for (let step = -CELLS; step < CELLS; step += 2) {
        for (const end of [step, step + 2]) vertex(k, end, k % 5 === 0);
        for (const end of [step, step + 2]) vertex(end, k, k % 5 === 0);
      }
    }
    const { geometry } = this.grid;
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(colors), 4));
  }

  /** Puts the grid under a point, in whole groups of cells so that it stands still. */
  center(at: Vector3): void {
    const back = this.turn.clone().invert();
    const flat = at.clone().applyQuaternion(back);
    const step = 5 * this.cell;
    const snapped = new Vector3(Math.round(flat.x / step) * step, Math.round(flat.y / step) * step, this.level);
    this.grid.position.copy(snapped.applyQuaternion(this.turn));
  }

  /** Maps every point along the light onto the plane; null where the plane is seen from below. */
  shadow(camera: Vector3): Matrix4 | null {
    if (this.planar || camera.dot(this.up) < this.level) return null;
    const n = this.up;
    const light = new Vector3(0.32, -0.22, 1).normalize().applyQuaternion(this.turn);
    const k = light.dot(n);
    const [l, d] = [light, this.level];
    // p − (n·p − d) l / (n·l)
    const entry = (i: number, j: number) =>
      (i === j ? 1 : 0) - (l.getComponent(i) * n.getComponent(j)) / k;
    const move = (i: number) => (d * l.getComponent(i)) / k;
    return new Matrix4().set(
      entry(0, 0), entry(0, 1), entry(0, 2), move(0),
      entry(1, 0), entry(1, 1), entry(1, 2), move(1),
      entry(2, 0), entry(2, 1), entry(2, 2), move(2),
      0, 0, 0, 1,
    );
  }
}
