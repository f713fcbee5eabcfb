// One run as objects of three.js: bodies, symbols, road, trails, shadows.

import {
  AxesHelper, Box3, BufferAttribute, BufferGeometry, Color, EdgesGeometry, Group, LineSegments, Matrix4, Mesh, Object3D,
  Quaternion, Raycaster, ShaderMaterial, Vector3,
} from "three";
import { Arrows } from "./arrows";
import { Batches, type Layer } from "./batch";
import type { Body, Frame, Road, Run, Shape } from "./data";
import { symbolOf, type Move } from "./elements";
import { paint, shadowGeometry, shapeGeometry, vector } from "./geometry";
import { placeAt, poseAt, type Place } from "./motion";
import { setTint, surface, trailMaterial } from "./surface";
import { BODIES, GHOSTS, STEEL, theme } from "./theme";

export interface Shows {
  joints: boolean;
  forces: boolean;
  trails: boolean;
  axes: boolean;
}

/** Places of one trail: more are not told apart. */
const TRAIL = 600;

export class World {
  readonly root = new Group();
  /** What moves; drawn by the batches. */
  private actors = new Group();
  readonly bodies: Group[] = [];
  private batches = new Batches();
  private moves: Move[] = [];
  readonly arrows: Arrows;
  place: Place = { frame: 0, part: 0 };
  /** Since the start of the run, s. */
  private now = 0;
  private ground = new Group();
  private boxes: (Box3 | null)[];
  private trails?: LineSegments;
  private shows: Shows = { joints: true, forces: false, trails: false, axes: false };
  private roads: Mesh[] = [];
  private up: Vector3;

  constructor(readonly run: Run, readonly number: number) {
    this.up = upOf(run);
    this.actors.add(this.ground);
    run.bodies.forEach((body) => {
      const group = new Group();
      group.name = body.name;
      this.bodies.push(group);
      this.actors.add(group);
    });
    this.addBodies();
    this.pose(run.start);
    if (number === 0) {
      const stage = {
        run,
        up: this.up,
        holder: (body: number | null) => (body === null ? this.ground : this.bodies[body]),
        place: (frame: Frame, target: Vector3) => this.placeOf(frame, target),
        batches: this.batches,
      };
      for (const element of run.elements) {
        const move = symbolOf(stage, element);
        if (move) this.moves.push(move);
      }
      run.roads.forEach((road) => this.roads.push(roadMesh(road)));
      for (const road of this.roads) this.root.add(road);
    }
    this.batches.build();
    this.root.add(this.batches.root);
    this.boxes = run.bodies.map((body) => this.batches.around(body.name));
    this.arrows = new Arrows(run, (frame, target) => this.placeOf(frame, target));
    if (number === 0) this.root.add(this.arrows.root);
    this.show(this.shows);
    this.paint();
    this.move(run.start);
  }

  /** Of the run, s. */
  private get length(): number {
    return this.run.times[this.run.times.length - 1];
  }

  /** A point of a frame, ground axes. */
  placeOf(frame: Frame, target: Vector3): Vector3 {
    target.set(...frame.point);
    if (frame.body === null) return target;
    const group = this.bodies[frame.body];
    return target.applyQuaternion(group.quaternion).add(group.position);
  }

  private pose(time: number): void {
    this.place = placeAt(this.run, time);
    this.now = time - this.run.start;
    this.run.bodies.forEach((body, k) => {
      poseAt(body, this.now, this.bodies[k].position, this.bodies[k].quaternion);
    });
  }

  move(time: number): void {
    this.pose(time);
    for (const move of this.moves) move();
    this.actors.updateMatrixWorld();
    const nearest = this.run.follow ?? 0;
    this.batches.place(this.bodies[nearest]?.position ?? new Vector3());
    this.arrows.move(this.place);
    if (this.trails) (this.trails.material as ShaderMaterial).uniforms.now.value = this.now;
  }

  /** To be called when the camera stands where it will look from. */
  cast(view: Matrix4, shadow: Matrix4 | null): void {
    this.batches.cast(view, shadow);
  }

  get shadowObject(): Object3D {
    return this.batches.shadows;
  }

  show(shows: Shows): void {
    this.shows = { ...shows };
    const shown = { body: true, edge: true, force: true, joint: shows.joints, axes: shows.axes, shadow: true };
    this.batches.show((layer) => shown[layer.kind]);
    this.arrows.shown = shows.forces ? "all" : "none";
    if (shows.trails && !this.trails) this.addTrails();
    if (this.trails) this.trails.visible = shows.trails;
  }

  set groundVisible(visible: boolean) {
    this.roads.forEach((road) => (road.visible = visible));
  }

  /** Marks an item. */
  pick(name: string | null): void {
    this.arrows.picked = name;
    this.batches.pick(name);
  }

  /** The item that a ray meets first; a joint just behind the surface of a body is meant, too. */
  hit(ray: Raycaster): string | null {
    const hits = this.batches.hits(ray);
    if (!hits.length) return null;
    const near = hits.filter((hit) => hit.distance - hits[0].distance < 0.03 * this.run.size);
    return (near.find((hit) => hit.layer.kind !== "body") ?? hits[0]).name;
  }

  /** Colours that follow the theme. */
  paint(): void {
    this.batches.edgeTint.value.setHex(theme.now.edge);
    this.batches.shadowTint.value.setHex(this.roads.length ? theme.now.roadShadow : theme.now.shadow);
    this.roads.forEach((road) => setTint(road.material as ShaderMaterial, theme.now.road));
  }

  /** Boxes around what there is: now, or over the whole run. */
  points(whole: boolean): Vector3[] {
    const points: Vector3[] = [];
    const [p, q] = [new Vector3(), new Quaternion()];
    const { boxes } = this;
    const count = whole ? 60 : 1;
    for (let k = 0; k < count; k++) {
      const time = whole ? (k / (count - 1)) * this.length : this.now;
      this.run.bodies.forEach((body, n) => {
        const box = boxes[n];
        if (!box) return;
        poseAt(body, time, p, q);
        for (const x of [box.min.x, box.max.x]) {
          for (const y of [box.min.y, box.max.y]) {
            for (const z of [box.min.z, box.max.z]) points.push(new Vector3(x, y, z).applyQuaternion(q).add(p));
          }
        }
      });
    }
    for (const element of this.run.elements) {
      for (const frame of element.frames) {
        if (frame.body === null && element.frames.length > 1) points.push(vector(frame.point));
      }
    }
    return points;
  }

  private addBodies(): void {
    const ghost = this.number > 0;
    const axes = new AxesHelper(0.09 * this.run.size).geometry;
    // Equal shapes are made once.
    const made = new Map<string, BufferGeometry>();
    const known = (key: string, make: () => BufferGeometry) => {
      if (!made.has(key)) made.set(key, make());
      return made.get(key)!;
    };
    this.run.bodies.forEach((body, k) => {
      const group = this.bodies[k];
      // What is drawn around joints lets them be seen.
      const around = body.shapes.some((shape) => shape.type === "hull");
      body.shapes.forEach((shape, n) => {
        const key = shape.type === "mesh" ? `${k} ${n}` : JSON.stringify(shape);
        const color = this.colorOf(body, shape);
        const geometry = known(`${key} ${color.getHexString()}`, () => paint(shapeGeometry(shape), color));
        const own = "opacity" in shape ? (shape.opacity ?? 1) : 1;
        const opacity = ghost ? 0.42 * own : around ? 0.5 * own : own;
        const layer: Layer = { kind: "body", opacity, ghost, bothSides: shape.type === "mesh" };
        this.batches.add(layer, body.name, geometry, group);
        if (!ghost && own > 0.2) {
          const shadow = shadowGeometry(shape);
          if (shadow) this.batches.addShadow(shadow, group);
        }
        if (ghost || !["box", "hull"].includes(shape.type)) return;
        const edges = known(`edges ${key}`, () => new EdgesGeometry(shapeGeometry(shape), 24));
        this.batches.add({ kind: "edge" }, body.name, edges, group);
      });
      if (!ghost) this.batches.add({ kind: "axes" }, body.name, axes, group);
    });
  }

  private colorOf(body: Body, shape: Shape): Color {
    if (this.number > 0) return new Color(GHOSTS[(this.number - 1) % GHOSTS.length]);
    if ("color" in shape && shape.color) {
      const [r, g, b] = shape.color;
      return new Color(r / 255, g / 255, b / 255);
    }
    const own = new Color(BODIES[body.kind % BODIES.length]);
    return shape.type === "wheel" ? own.lerp(new Color(STEEL), 0.6) : own;
  }

  /** The ways of the centres of mass, made when they are asked for first. */
  private addTrails(): void {
    const { run } = this;
    const at = Array.from({ length: TRAIL }, (_, k) => (k / (TRAIL - 1)) * this.length);
    const [p, q, c] = [new Vector3(), new Quaternion(), new Vector3()];
    const segments = run.bodies.length * (TRAIL - 1);
    const places = new Float32Array(6 * segments);
    const colors = new Float32Array(6 * segments);
    const seen = new Float32Array(2 * segments);
    let end = 0;
    run.bodies.forEach((body) => {
      const color = this.number > 0 ? new Color(GHOSTS[(this.number - 1) % GHOSTS.length]) : new Color(BODIES[body.kind % BODIES.length]);
      const before = new Vector3();
      at.forEach((time, k) => {
        poseAt(body, time, p, q);
        c.set(...body.center).applyQuaternion(q).add(p);
        if (k > 0) {
          for (const point of [before, c]) {
            point.toArray(places, 3 * end);
            color.toArray(colors, 3 * end);
            seen[end++] = time;
          }
        }
        before.copy(c);
      });
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(places, 3));
    geometry.setAttribute("color", new BufferAttribute(colors, 3));
    geometry.setAttribute("time", new BufferAttribute(seen, 1));
    this.trails = new LineSegments(geometry, trailMaterial());
    this.trails.frustumCulled = false;
    this.root.add(this.trails);
  }

  /** To be called when rows have come. */
  extend(): void {
    this.arrows.measure();
    if (this.trails) {
      this.root.remove(this.trails);
      this.trails.geometry.dispose();
      this.trails = undefined;
      this.show(this.shows);
    }
    this.roads.forEach((road) => {
      this.root.remove(road);
      road.geometry.dispose();
    });
    this.roads = this.run.roads.map(roadMesh);
    for (const road of this.roads) this.root.add(road);
  }
}

/** Up is against gravity; without gravity z in space, y in the plane. */
export function upOf(run: Run): Vector3 {
  if (run.dimension === "planar") return new Vector3(0, 1, 0);
  const up = vector(run.gravity).negate();
  return up.lengthSq() > 0 ? up.normalize() : new Vector3(0, 0, 1);
}

function roadMesh(road: Road): Mesh {
  const places: number[] = [];
  const faces: number[] = [];
  road.x.forEach((x, k) => {
    places.push(x, road.y[0], road.height[k], x, road.y[1], road.height[k]);
    if (k > 0) faces.push(2 * k - 2, 2 * k, 2 * k - 1, 2 * k, 2 * k + 1, 2 * k - 1);
  });
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
  geometry.setIndex(faces);
  geometry.computeVertexNormals();
  const material = surface({ color: theme.now.road, bothSides: true });
  const mesh = new Mesh(geometry, material);
  mesh.renderOrder = -3;
  return mesh;
}
