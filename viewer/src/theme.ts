// Colours of the page and of the picture.

export interface Theme {
  dark: boolean;
  background: number;
  grid: number;
  gridStrength: number;
  road: number;
  /** On the plain ground, and on a road. */
  shadow: number;
  roadShadow: number;
  edge: number;
}

export const LIGHT: Theme = {
  dark: false,
  background: 0xeef0ef,
  grid: 0x7d8890,
  gridStrength: 0.42,
  road: 0xdadddd,
  shadow: 0xcfd4d6,
  roadShadow: 0xb9bec1,
  edge: 0x3a444c,
};

export const DARK: Theme = {
  dark: true,
  background: 0x171a1d,
  grid: 0x8b98a2,
  gridStrength: 0.26,
  road: 0x2a2f34,
  shadow: 0x0f1113,
  roadShadow: 0x1b1f22,
  edge: 0x0c0e10,
};

/** Bodies, the heaviest first; equal bodies have one colour. */
export const BODIES = [
  0x8797a5, 0x3f678f, 0xb8744a, 0x6a9276, 0xc2a04a, 0x85709c, 0x4b8b8d, 0xa96464, 0x7c8a55, 0x9a7f6c,
];
/** Joints and bearings on the ground: seen on light and on dark. */
export const JOINT = 0x475460;
export const JOINT_LIGHT = 0xe4e8ea;
export const BEARING = 0x87929b;
export const SPRING = 0xd98324;
export const DAMPER = 0x56636d;
export const STEEL = 0xb9c2c8;
export const TYRE = 0x30363b;
export const RUBBER = 0x7a5a48;
export const DRIVER = 0x2e8b6f;
export const FORCE = 0xc43d4b;
export const PICKED = 0x1d74d8;
/** Runs laid over the first one. */
export const GHOSTS = [0x1d74d8, 0xd0562b, 0x2e9b62];
export const GHOSTS_CSS = ["#1d74d8", "#d0562b", "#2e9b62"];

/** Curves, as in `holonom/pictures/picture.py`: apart for colour-blind readers, on light and on dark paper. */
export const CURVES = ["#3f7fbf", "#d9792b", "#3d9a6a", "#b0589f", "#8a7a3c", "#6f6f9f"];

export const theme = { now: LIGHT };
