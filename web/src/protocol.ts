/** What page and server say to each other, version 5: its types are made of the protocol's schema. Lengths mm, angles degrees, world RAS. */

import type { FrameHeader, GeometryHeader, Hello, MeshHeader, OfferedExercise, Protocol } from "./protocol.gen";
import type { Signal } from "./signal";
import type { ThumbHeader } from "./trainer.gen";

export type {
  ColourPlace, Command, Comment, Course, Debrief, Exercises, ExpertBand, FrameHeader, Happened, Hello, ImageSettings, Loading, LoggedEvent, MeasuredMetric, MeshHeader, NeedleCommand, NeedlePlace, Notice, OfferedExercise, OfferedMark, OfferedModel,
  ProbeOutline, Readouts, Refused, RunningAttempt, StationMessage, TargetPlace,
  SceneKnob as Knob, SceneMessage as Scene, SkinDirections, TissueSettings,
} from "./protocol.gen";

export type ServerText = Protocol["server"];
export type ClientText = Protocol["client"];
export type Guide = OfferedExercise["guides"][number];

/** A page that was left open while the server was replaced must not guess. */
export const PROTOCOL: Hello["protocol"] = 5;

/** Say so where page and server are of two versions. */
export function compareVersions(protocol: number, broken: Signal<string>): void {
  if (protocol !== PROTOCOL) broken.emit(`The server speaks version ${protocol}, this page ${PROTOCOL}: reload the page`);
}

/** One drawn-to-be image with everything that belongs to it. */
export interface Frame {
  header: FrameHeader;
  pixels: Uint8Array;
  /** (3 x vertices) world positions of the meshes in the order of the geometry, or null where nothing moved. */
  positions: Float32Array | null;
  /** Levels of colour Doppler in its window, or null where it is off. */
  colour: Int8Array | null;
}

export interface MeshData {
  info: MeshHeader;
  positions: Float32Array;
  indices: Uint32Array;
}

export interface Geometry {
  meshes: MeshData[];
}

/** A small picture of a station. */
export interface Thumb {
  header: ThumbHeader;
  pixels: Uint8Array;
}

export type Binary = { kind: "frame"; frame: Frame } | { kind: "geometry"; geometry: Geometry } | { kind: "thumb"; thumb: Thumb };

const FRAME = 1;
const GEOMETRY = 2;
const THUMB = 3;

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
  if (kind === THUMB) return { kind: "thumb", thumb: thumb(buffer, start, header as ThumbHeader) };
  throw new RangeError(`kind = ${kind} is not known; this page knows 1 to 3`);
}

function frame(buffer: ArrayBuffer, start: number, header: FrameHeader): Frame {
  const count = header.rows * header.columns;
  const pixels = new Uint8Array(buffer, start, count);
  const behind = start + 4 * Math.ceil(count / 4);
  const positions = header.mesh > 0 ? new Float32Array(buffer, behind, 3 * header.mesh) : null;
  const { colour } = header;
  const levels = colour ? new Int8Array(buffer, behind + 12 * header.mesh, colour.rows * colour.columns) : null;
  return { header, pixels, positions, colour: levels };
}

function thumb(buffer: ArrayBuffer, start: number, header: ThumbHeader): Thumb {
  return { header, pixels: new Uint8Array(buffer, start, header.rows * header.columns) };
}

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
