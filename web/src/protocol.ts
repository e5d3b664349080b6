/** What page and server say to each other, version 1. Lengths mm, angles degrees, world RAS. */

import type { Vec } from "./vec";

export interface NeedlePose { u: number; v: number; angle: number; swing: number; depth: number }
export interface ProbePose { slide: number; sweep: number; rotate: number; fan: number }
export interface ImageSettings { gain: number; depth: number; frequency: number; focus: number }

/** The whole command of the hand, or what is in force. */
export interface State { needle: NeedlePose; probe: ProbePose; image: ImageSettings; frozen: boolean }

export type Range = readonly [number, number];
export interface Limits {
  needle: Record<keyof NeedlePose, Range>;
  probe: Record<keyof ProbePose, Range>;
  image: Record<keyof ImageSettings, Range>;
}

export interface Model { id: string; name: string; available: boolean; reason: string | null }
export interface MeshInfo {
  name: string;
  kind: "surface" | "lines";
  colour: string;
  opacity: number;
  vertices: number;
  indices: number;
}
export interface ProbeInfo {
  name: string;
  kind: "curvilinear" | "linear" | "phased";
  radius_mm: number;
  aperture_mm: number;
  field_of_view_deg: number;
}
/**
 * `out` = right x depth. With right to the right and depth downwards it points into the screen: away from who looks at
 * the image, as the image's own z does.
 */
export interface SceneFrame { right: Vec; depth: Vec; out: Vec; skin_origin: Vec }

export interface Hello {
  type: "hello";
  version: string;
  protocol: number;
  scenes: { id: string; name: string; description: string }[];
  scene: string;
  notice: string;
  /** The key with which this page comes back to its session, whether it has, and how long it is kept, s. */
  session: string;
  resumed: boolean;
  kept_s: number;
}
export interface Loading { type: "loading"; scene: string; name: string; share: number }
export interface Scene {
  type: "scene";
  id: string;
  name: string;
  description: string;
  frame: SceneFrame;
  box: { low: Vec; high: Vec };
  models: Model[];
  model: string;
  probe: ProbeInfo;
  needle: { length_mm: number; diameter_mm: number };
  targets: { id: string; name: string; rest: Vec }[];
  target: string;
  tolerance_mm: number;
  half_slice_mm: number;
  limits: Limits;
  /** What is in force, and where the scene starts. */
  state: State;
  start: State;
}
export interface Refused {
  type: "refused";
  what: string;
  message: string;
  file?: string | null;
  line?: number | null;
  seq?: number;
}
export interface Notice { type: "notice"; level: "caution" | "fault"; message: string }
/** Why a needle is not where it was asked to be. */
export type Blocked = "end of needle" | "leaves the tissue" | "needle inside";
export type ServerText =
  | Hello
  | Loading
  | Scene
  | Refused
  | Notice
  | { type: "target"; id: string }
  | { type: "model"; model: string }
  | { type: "pong" };

export type ClientText =
  | ({ type: "state"; seq: number } & State)
  | { type: "drawn"; frame: number }
  | { type: "model"; model: string }
  | { type: "target"; id: string }
  | { type: "scene"; id: string }
  | { type: "open_scene"; name: string; text: string }
  | { type: "undo_pass" }
  | { type: "reset" }
  | { type: "restore" }
  | { type: "view"; grid: boolean; ahead: 0 | 1 }
  | { type: "ping" };

export interface Readouts {
  tip_to_target: number | null;
  depth: number;
  moved: number | null;
  moved_parts: Vec | null;
  out_of_plane: number;
  half_slice: number;
  folds: boolean;
  estimate: number | null;
}
export interface FrameHeader {
  frame: number;
  seq: number;
  rows: number;
  columns: number;
  pixel: readonly [number, number];
  image_to_reference: Vec;
  probe_to_reference: Vec;
  state: State;
  blocked: Blocked | null;
  needle: { entry: Vec; tip: Vec; direction: Vec };
  target: { id: string; now: Vec; rest: Vec } | null;
  readouts: Readouts;
  pass: { time_s: number; passes: number; tip_path_mm: number; max_off_plane_mm: number };
  /** Which model answered. */
  model: string;
  server_ms: number;
  step_ms: number;
  render_ms: number;
  frozen: boolean;
  mesh: number;
  grid?: boolean;
}

/** One drawn-to-be image with everything that belongs to it. */
export interface Frame {
  header: FrameHeader;
  pixels: Uint8Array;
  /** (3 x vertices) world positions of the meshes in the order of the geometry, or null where nothing moved. */
  positions: Float32Array | null;
}

export interface MeshData {
  info: MeshInfo;
  positions: Float32Array;
  indices: Uint32Array;
}

export interface Geometry {
  meshes: MeshData[];
}

export type Binary = { kind: "frame"; frame: Frame } | { kind: "geometry"; geometry: Geometry };

const FRAME = 1;
const GEOMETRY = 2;

/** Take a binary message apart without copying it. */
export function decode(buffer: ArrayBuffer): Binary {
  if (buffer.byteLength < 8) throw new RangeError(`a binary message of ${buffer.byteLength} bytes has no header`);
  const view = new DataView(buffer);
  const kind = view.getUint32(0, true);
  const length = view.getUint32(4, true);
  const start = 8 + length;
  if (start > buffer.byteLength || start % 8) throw new RangeError(`header_bytes = ${length} does not fit the message`);
  const header: unknown = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  if (kind === FRAME) return { kind: "frame", frame: frame(buffer, start, header as FrameHeader) };
  if (kind === GEOMETRY) return { kind: "geometry", geometry: geometry(buffer, start, header as GeometryHeader) };
  throw new RangeError(`kind = ${kind} is not known; this page knows 1 and 2`);
}

function frame(buffer: ArrayBuffer, start: number, header: FrameHeader): Frame {
  const count = header.rows * header.columns;
  const pixels = new Uint8Array(buffer, start, count);
  const behind = start + 4 * Math.ceil(count / 4);
  const positions = header.mesh > 0 ? new Float32Array(buffer, behind, 3 * header.mesh) : null;
  return { header, pixels, positions };
}

interface GeometryHeader { meshes: MeshInfo[] }

function geometry(buffer: ArrayBuffer, start: number, header: GeometryHeader): Geometry {
  let at = start;
  const meshes = header.meshes.map((info) => {
    const positions = new Float32Array(buffer, at, 3 * info.vertices);
    at += positions.byteLength;
    const indices = new Uint32Array(buffer, at, info.indices);
    at += indices.byteLength;
    return { info, positions, indices };
  });
  return { meshes };
}
