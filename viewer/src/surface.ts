// The one surface of the picture: matte, lit per vertex. A renderer in software has to be fast
// with it, too, so that a pixel costs no more than its colour.

import {
  Color, DoubleSide, FrontSide, ShaderMaterial, Vector3, type IUniform, type ShaderMaterialParameters,
} from "three";
import type { Layer } from "./batch";
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

const SHADE = `
  vec3 lit(vec3 face, vec3 paint) {
    float sky = 0.5 + 0.5 * dot(face, up);
    float direct = max(0.0, dot(face, sun));
    return paint * (0.42 + 0.24 * sky + 0.4 * direct) + 0.03 * direct;
  }`;

const VERTEX = `
  uniform vec3 sun, up, tint;
  varying vec3 shade;
  ${SHADE}
  void main() {
    vec4 place = vec4(position, 1.0);
    vec3 face = normal;
    #ifdef USE_INSTANCING
      place = instanceMatrix * place;
      face = mat3(instanceMatrix) * face;
    #endif
    shade = lit(normalize(mat3(modelMatrix) * face), tint);
    gl_Position = projectionMatrix * modelViewMatrix * place;
  }`;

/** Rows of the matrix of an actor: where its points are. */
const ACTOR = `
  uniform highp sampler2D poses;
  attribute vec2 tag;
  vec4 rows[3];
  void enter() {
    int slot = int(tag.x + 0.5);
    for (int k = 0; k < 3; k++) rows[k] = texelFetch(poses, ivec2(3 * (slot % 64) + k, slot / 64), 0);
  }
  vec3 placed(vec3 p) {
    return vec3(dot(rows[0], vec4(p, 1.0)), dot(rows[1], vec4(p, 1.0)), dot(rows[2], vec4(p, 1.0)));
  }
  vec3 turned(vec3 v) {
    return vec3(dot(rows[0].xyz, v), dot(rows[1].xyz, v), dot(rows[2].xyz, v));
  }`;

const ACTOR_VERTEX = `
  uniform vec3 sun, up;
  uniform float picked;
  varying vec3 shade;
  ${ACTOR}
  ${SHADE}
  void main() {
    enter();
    vec3 face = normalize(turned(normal));
    shade = lit(face, color.rgb);
    bool marked = abs(tag.y - picked) < 0.5;
    if (marked) shade = mix(shade, MARKED * (0.72 + 0.5 * max(0.0, dot(face, sun))), 0.6);
    #ifdef MARKED_ONLY
      if (!marked) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    #endif
    gl_Position = projectionMatrix * modelViewMatrix * vec4(placed(position), 1.0);
  }`;

const LINE_VERTEX = `
  uniform vec3 tint;
  varying vec3 shade;
  ${ACTOR}
  void main() {
    enter();
    shade = LINE;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(placed(position), 1.0);
  }`;

const SHADOW_VERTEX = `
  uniform mat4 thrown;
  ${ACTOR}
  void main() {
    enter();
    gl_Position = thrown * vec4(placed(position), 1.0);
  }`;

const FRAGMENT = `
  uniform float opacity;
  varying vec3 shade;
  void main() { gl_FragColor = vec4(shade, opacity); }`;

interface Look extends ShaderMaterialParameters {
  color: number;
  bothSides?: boolean;
}

/** Of what is no part of a body: roads and arrows. */
export function surface({ color, bothSides = false, ...more }: Look): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    side: bothSides ? DoubleSide : FrontSide,
    uniforms: { ...light, tint: { value: new Color(color) }, opacity: { value: 1 } },
    ...more,
  });
}

/** Of the parts of a layer; or, through all that covers it, of the one that is picked. */
export function actorMaterial(layer: Layer, uniforms: Record<string, IUniform>, through = false): ShaderMaterial {
  const lines = layer.kind === "edge" || layer.kind === "axes";
  const opacity = layer.kind === "edge" ? 0.45 : through ? 0.4 : layer.opacity ?? 1;
  const { r, g, b } = new Color(PICKED);
  return new ShaderMaterial({
    vertexShader: lines ? LINE_VERTEX : ACTOR_VERTEX,
    fragmentShader: FRAGMENT,
    vertexColors: true,
    defines: {
      MARKED: `vec3(${[r, g, b].map((part) => part.toFixed(3)).join(", ")})`,
      LINE: layer.kind === "edge" ? "tint" : "color.rgb",
      ...(through ? { MARKED_ONLY: "1" } : {}),
    },
    side: layer.bothSides ? DoubleSide : FrontSide,
    transparent: opacity < 1,
    depthTest: layer.kind !== "axes" && !through,
    depthWrite: !layer.ghost && !lines && !through,
    uniforms: { ...light, ...uniforms, opacity: { value: opacity } },
  });
}

/** One colour, no light; opaque, before everything that stands on the ground: neither blending nor depth is paid for. */
export function shadowMaterial(uniforms: Record<string, IUniform>): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: SHADOW_VERTEX,
    fragmentShader: "uniform vec3 tint; void main() { gl_FragColor = vec4(tint, 1.0); }",
    side: DoubleSide,
    depthTest: false,
    depthWrite: false,
    uniforms,
  });
}

/** Lines that are seen up to a time. */
export function trailMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: `
      attribute float time;
      uniform float now;
      varying vec3 shade;
      void main() {
        shade = color;
        gl_Position = time > now ? vec4(2.0, 2.0, 2.0, 1.0) : projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }`,
    fragmentShader: FRAGMENT,
    vertexColors: true,
    transparent: true,
    depthTest: false,
    uniforms: { now: { value: 0 }, opacity: { value: 0.9 } },
  });
}

export const setTint = (material: ShaderMaterial, color: number) => {
  (material.uniforms.tint.value as Color).setHex(color);
};
