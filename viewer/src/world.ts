// One run as objects of three.js: bodies, symbols, road, trails, shadows.

import {
  BufferAttribute, BufferGeometry, Color, EdgesGeometry, Group, Line, LineBasicMaterial, LineSegments, Matrix4, Mesh,
  Object3D, Quaternion, Raycaster, ShaderMaterial, Sphere, Vector3, AxesHelper,
} from "three";
import { Arrows } from "./arrows";
import { Bundle } from "./bundle";
import type { Frame, Road, Run } from "./data";
import { symbolOf, type Symbol } from "./elements";
import { merge, paint, shapeGeometry, vector } from "./geometry";
import { placeAt, poseAt, type Place } from "./motion";
import { mark, plain, setTint, surface } from "./surface";
import { BODIES, GHOSTS, STEEL, theme } from "./theme";

export interface Shows {
  joints: boolean;
  forces: boolean;
  trails: boolean;
  axes: boolean;
}

export class World {
  readonly root = new Group();
  readonly bodies: Group[] = [];
  readonly meshes: Mesh[] = [];
  readonly symbols: Symbol[] = [];
  private bundles = new Map<number | null, Bundle>();
  readonly arrows: Arrows;
  place: Place = { frame: 0, part: 0 };
  private ground = new Group();
  private shadows: Mesh[] = [];
  private shadowRoot = new Group();
  private trails: Line[] = [];
  private axes: AxesHelper[] = [];
  private roads: Mesh[] = [];
  private up: Vector3;

  constructor(readonly run: Run, readonly number: number) {
    this.up = upOf(run);
    this.root.add(this.ground);
    run.bodies.forEach((body) => {
      const group = new Group();
      group.name = body.name;
      this.bodies.push(group);
      this.root.add(group);
    });
    this.addBodies();
    this.move(run.start);
    if (number === 0) {
      const stage = {
        run,
        up: this.up,
        holder: (body: number | null) => (body === null ? this.ground : this.bodies[body]),
        place: (frame: Frame, target: Vector3) => this.placeOf(frame, target),
        bundle: (body: number | null) => {
          if (!this.bundles.has(body)) this.bundles.set(body, new Bundle());
          return this.bundles.get(body)!;
        },
      };
      for (const element of run.elements) {
        const symbol = symbolOf(stage, element);
        if (symbol) this.symbols.push(symbol);
      }
      for (const [body, bundle] of this.bundles) bundle.build(stage.holder(body));
      this.addShadows();
      run.roads.forEach((road) => this.roads.push(roadMesh(road)));
      this.roads.forEach((road) => this.ground.add(road));
    }
    this.arrows = new Arrows(run, (frame, target) => this.placeOf(frame, target));
    if (number === 0) this.root.add(this.arrows.root);
    this.addTrails();
    this.paint();
    this.move(run.start);
  }

  /** A point of a frame, ground axes. */
  placeOf(frame: Frame, target: Vector3): Vector3 {
    target.set(...frame.point);
    if (frame.body === null) return target;
    const group = this.bodies[frame.body];
    return target.applyQuaternion(group.quaternion).add(group.position);
  }

  move(time: number): void {
    this.place = placeAt(this.run, time);
    this.run.bodies.forEach((body, k) => {
      poseAt(body, this.place, this.bodies[k].position, this.bodies[k].quaternion);
    });
    for (const symbol of this.symbols) symbol.move?.();
    this.arrows?.move(this.place);
    for (const trail of this.trails) trail.geometry.setDrawRange(0, this.place.frame + 1);
  }

  /** To be called after the world matrices are up to date. */
  cast(shadow: Matrix4 | null): void {
    this.shadowRoot.visible = shadow !== null;
    if (!shadow) return;
    this.shadows.forEach((mesh) => {
      mesh.matrix.multiplyMatrices(shadow, (mesh.userData.of as Mesh).matrixWorld);
      mesh.matrixWorld.copy(mesh.matrix);
    });
  }

  get shadowObject(): Object3D {
    return this.shadowRoot;
  }

  show(shows: Shows): void {
    for (const symbol of this.symbols) {
      for (const mesh of symbol.meshes) {
        mesh.visible = symbol.element.collection === "forces" || shows.joints || symbol.element.type === "distance";
      }
    }
    this.bundles.forEach((bundle) => bundle.show(shows.joints));
    this.arrows.shown = shows.forces ? "all" : "none";
    this.trails.forEach((trail) => (trail.visible = shows.trails));
    this.axes.forEach((axes) => (axes.visible = shows.axes));
  }

  set groundVisible(visible: boolean) {
    this.roads.forEach((road) => (road.visible = visible));
  }

  /** Marks an item, and says whether there is one of that name. */
  pick(name: string | null): void {
    this.arrows.picked = name;
    for (const mesh of [...this.meshes, ...this.symbols.flatMap((symbol) => symbol.meshes)]) mark(mesh, mesh.name === name);
    this.bundles.forEach((bundle) => bundle.mark(name));
  }

  private get fixed(): Mesh[] {
    return [...this.bundles.values()].map((bundle) => bundle.mesh);
  }

  /** The item that a ray meets first; a joint just behind the surface of a body is meant, too. */
  hit(ray: Raycaster): string | null {
    const moving = this.symbols.flatMap((symbol) => symbol.meshes).filter((mesh) => mesh.visible);
    const symbols = new Set<Object3D>([...moving, ...this.fixed]);
    const hits = ray.intersectObjects([...this.meshes, ...symbols], false);
    if (!hits.length) return null;
    const near = hits.filter((hit) => hit.distance - hits[0].distance < 0.03 * this.run.size);
    const best = near.find((hit) => symbols.has(hit.object)) ?? hits[0];
    const bundle = [...this.bundles.values()].find((one) => one.mesh === best.object);
    return bundle ? bundle.nameAt(best.faceIndex!) : best.object.name;
  }

  /** Colours that follow the theme. */
  paint(): void {
    this.root.traverse((object) => {
      if (object.userData.edge) ((object as LineSegments).material as LineBasicMaterial).color.setHex(theme.now.edge);
    });
    this.roads.forEach((road) => setTint(road.material as ShaderMaterial, theme.now.road));
    this.shadows.forEach((mesh) => setTint(mesh.material as ShaderMaterial, this.roads.length ? theme.now.roadShadow : theme.now.shadow));
  }

  /** Boxes around what there is: now, or over the whole run. */
  points(whole: boolean): Vector3[] {
    const points: Vector3[] = [];
    const [p, q] = [new Vector3(), new Quaternion()];
    const spheres = this.meshes.map((mesh) => {
      if (!mesh.geometry.boundingSphere) mesh.geometry.computeBoundingSphere();
      return mesh.geometry.boundingSphere as Sphere;
    });
    const count = whole ? Math.min(60, this.run.times.length) : 1;
    for (let k = 0; k < count; k++) {
      const frame = whole ? Math.round((k * (this.run.times.length - 1)) / Math.max(1, count - 1)) : this.place.frame;
      this.run.bodies.forEach((body, n) => {
        if (!spheres[n]) return;
        poseAt(body, { frame, part: 0 }, p, q);
        const center = spheres[n].center.clone().applyQuaternion(q).add(p);
        const r = spheres[n].radius * 0.8;
        for (const [x, y, z] of [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) {
          points.push(center.clone().add(new Vector3(x * r, y * r, z * r)));
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
    this.run.bodies.forEach((body, k) => {
      const color = ghost ? GHOSTS[(this.number - 1) % GHOSTS.length] : BODIES[body.kind % BODIES.length];
      const parts = body.shapes.map((shape) => {
        const tint = new Color(color);
        return paint(shapeGeometry(shape), shape.type === "wheel" && !ghost ? tint.lerp(new Color(STEEL), 0.6) : tint);
      });
      // What is drawn around joints lets them be seen.
      const around = body.shapes.some((shape) => shape.type === "hull");
      const look = ghost ? { opacity: 0.42, depthWrite: false } : { opacity: around ? 0.5 : 1 };
      const mesh = new Mesh(merge(parts), surface(look));
      mesh.name = body.name;
      this.meshes.push(mesh);
      this.bodies[k].add(mesh);
      const sharp = body.shapes.filter((shape) => shape.type === "box" || shape.type === "hull");
      if (sharp.length && !ghost) {
        const outlines = sharp.map((shape) => new EdgesGeometry(shapeGeometry(shape), 24));
        const edges = new LineSegments(merge(outlines), new LineBasicMaterial({ transparent: true, opacity: 0.45 }));
        edges.userData.edge = true;
        this.bodies[k].add(edges);
      }
      const axes = new AxesHelper(0.09 * this.run.size);
      (axes.material as LineBasicMaterial).depthTest = false;
      axes.renderOrder = 5;
      axes.visible = false;
      this.axes.push(axes);
      this.bodies[k].add(axes);
    });
  }

  private addShadows(): void {
    // Opaque, before everything that stands on the ground: neither blending nor depth is paid for.
    const material = plain({ depthTest: false, depthWrite: false });
    const cast = (of: Mesh, geometry: BufferGeometry) => {
      const shadow = new Mesh(geometry, material);
      shadow.matrixAutoUpdate = shadow.matrixWorldAutoUpdate = false;
      shadow.frustumCulled = false;
      shadow.renderOrder = -2;
      shadow.userData.of = of;
      this.shadows.push(shadow);
      this.shadowRoot.add(shadow);
    };
    this.meshes.forEach((mesh) => cast(mesh, mesh.geometry));
    for (const bundle of this.bundles.values()) {
      const { solid } = bundle;
      if (solid) cast(bundle.mesh, solid);
    }
  }

  private addTrails(): void {
    const { run } = this;
    const count = run.times.length;
    const [p, q, c] = [new Vector3(), new Quaternion(), new Vector3()];
    run.bodies.forEach((body) => {
      const places = new Float32Array(3 * count);
      for (let frame = 0; frame < count; frame++) {
        poseAt(body, { frame, part: 0 }, p, q);
        c.set(...body.center).applyQuaternion(q).add(p).toArray(places, 3 * frame);
      }
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(places, 3));
      const color = this.number > 0 ? GHOSTS[(this.number - 1) % GHOSTS.length] : BODIES[body.kind % BODIES.length];
      const trail = new Line(geometry, new LineBasicMaterial({ color, transparent: true, opacity: 0.9, depthTest: false }));
      trail.frustumCulled = false;
      trail.visible = false;
      this.trails.push(trail);
      this.root.add(trail);
    });
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
