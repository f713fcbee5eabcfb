// The one surface of the picture: matte, lit per vertex. A renderer in software has to be fast
// with it, too, so that a pixel costs no more than its colour.

import { Color, DoubleSide, FrontSide, ShaderMaterial, Vector3, type Mesh, type ShaderMaterialParameters } from "three";
import { PICKED } from "./theme";

/** Shared by all surfaces: the sun, what is up, and how bright it is. */
const light = {
  sun: { value: new Vector3(0, 0, 1) },
  up: { value: new Vector3(0, 0, 1) },
};

export function setLight(sun: Vector3, up: Vector3): void {
  light.sun.value.copy(sun).normalize();
  light.up.value.copy(up).normalize();
}

const VERTEX = `
  uniform vec3 sun, up, tint;
  varying vec3 shade;
  void main() {
    vec4 place = vec4(position, 1.0);
    vec3 face = normal;
    #ifdef USE_INSTANCING
      place = instanceMatrix * place;
      face = mat3(instanceMatrix) * face;
    #endif
    face = normalize(mat3(modelMatrix) * face);
    vec3 paint = tint;
    #ifdef USE_COLOR
      paint *= color;
    #endif
    float sky = 0.5 + 0.5 * dot(face, up);
    float direct = max(0.0, dot(face, sun));
    shade = paint * (0.42 + 0.24 * sky + 0.4 * direct) + 0.03 * direct;
    #ifdef MARKED
      shade = mix(shade, vec3(MARKED) * (0.72 + 0.5 * direct), 0.6);
    #endif
    gl_Position = projectionMatrix * modelViewMatrix * place;
  }`;

const FRAGMENT = `
  uniform float opacity;
  varying vec3 shade;
  void main() { gl_FragColor = vec4(shade, opacity); }`;

interface Look extends ShaderMaterialParameters {
  color?: number;
  opacity?: number;
  bothSides?: boolean;
}

/** What looks alike is one material: changing it costs more than drawing a small symbol. */
const made = new Map<string, ShaderMaterial>();
const marked = new Map<ShaderMaterial, ShaderMaterial>();

/** Without a colour the geometry brings its own. */
export function surface({ color, opacity = 1, bothSides = false, ...more }: Look = {}): ShaderMaterial {
  const key = JSON.stringify([color, opacity, bothSides, more]);
  const known = made.get(key);
  if (known) return known;
  const material = new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    vertexColors: color === undefined,
    side: bothSides ? DoubleSide : FrontSide,
    transparent: opacity < 1,
    uniforms: {
      ...light,
      tint: { value: new Color(color ?? 0xffffff) },
      opacity: { value: opacity },
    },
    ...more,
  });
  made.set(key, material);
  const picked = material.clone();
  const { r, g, b } = new Color(PICKED);
  picked.defines = { MARKED: [r, g, b].map((part) => part.toFixed(3)).join(", ") };
  Object.assign(picked.uniforms, light, { tint: material.uniforms.tint });
  marked.set(material, picked);
  return material;
}

/** The same material for what is picked. */
export const markedOf = (material: ShaderMaterial) => marked.get(material) ?? material;

/** Shows that an object is picked, or that it is not. */
export function mark(mesh: Mesh, on: boolean): void {
  mesh.userData.material ??= mesh.material;
  const own = mesh.userData.material as ShaderMaterial;
  mesh.material = on ? markedOf(own) : own;
}

/** One colour, no light: what shadows are made of. */
export function plain(parameters: ShaderMaterialParameters): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: "void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
    fragmentShader: "uniform vec3 tint; void main() { gl_FragColor = vec4(tint, 1.0); }",
    uniforms: { tint: { value: new Color(0xffffff) } },
    ...parameters,
  });
}

export const setTint = (material: ShaderMaterial, color: number) => {
  (material.uniforms.tint.value as Color).setHex(color);
};
