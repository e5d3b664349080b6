import { describe, expect, it } from "vitest";
import { decode, type FrameHeader } from "../src/protocol";

function message(kind: number, header: object, ...payload: (Uint8Array | Float32Array | Uint32Array)[]): ArrayBuffer {
  let text = JSON.stringify(header);
  text += " ".repeat((8 - ((8 + text.length) % 8)) % 8);
  const size = payload.reduce((sum, part) => sum + part.byteLength, 0);
  const buffer = new ArrayBuffer(8 + text.length + size);
  const view = new DataView(buffer);
  view.setUint32(0, kind, true);
  view.setUint32(4, text.length, true);
  const bytes = new Uint8Array(buffer);
  bytes.set(new TextEncoder().encode(text), 8);
  let at = 8 + text.length;
  for (const part of payload) {
    bytes.set(new Uint8Array(part.buffer, part.byteOffset, part.byteLength), at);
    at += part.byteLength;
  }
  return buffer;
}

describe("decode", () => {
  it("takes the pixels of a frame and the positions behind their padding", () => {
    const pixels = Uint8Array.of(1, 2, 3, 4, 5, 6, 0, 0);
    const positions = Float32Array.of(1, 2, 3, 4, 5, 6);
    const result = decode(message(1, { frame: 7, rows: 2, columns: 3, mesh: 2 }, pixels, positions));
    if (result.kind !== "frame") throw new Error("no frame");
    expect([...result.frame.pixels]).toEqual([1, 2, 3, 4, 5, 6]);
    expect([...(result.frame.positions ?? [])]).toEqual([1, 2, 3, 4, 5, 6]);
    expect((result.frame.header as FrameHeader).frame).toBe(7);
  });

  it("takes the colours that follow everything else", () => {
    const colour = { row: 1, column: 0, rows: 1, columns: 3, nyquist_cm_s: 20, outline: [] };
    const header = { rows: 2, columns: 3, mesh: 1, colour };
    const bytes = Uint8Array.of(1, 2, 3, 4, 5, 6, 0, 0);
    const result = decode(message(1, header, bytes, Float32Array.of(1, 2, 3), Uint8Array.of(128, 255, 127)));
    expect(result.kind === "frame" && [...(result.frame.colour ?? [])]).toEqual([-128, -1, 127]);
  });

  it("has no positions where nothing moved", () => {
    const result = decode(message(1, { rows: 1, columns: 4, mesh: 0 }, Uint8Array.of(9, 9, 9, 9)));
    expect(result.kind === "frame" && result.frame.positions).toBeNull();
  });

  it("takes the meshes of a geometry in order", () => {
    const meshes = [{ name: "skin", vertices: 2, indices: 3 }, { name: "grid", vertices: 1, indices: 2 }];
    const result = decode(
      message(2, { meshes }, Float32Array.of(0, 1, 2, 3, 4, 5), Uint32Array.of(0, 1, 1), Float32Array.of(7, 8, 9), Uint32Array.of(0, 0)),
    );
    if (result.kind !== "geometry") throw new Error("no geometry");
    expect(result.geometry.meshes.map(({ info }) => info.name)).toEqual(["skin", "grid"]);
    expect([...result.geometry.meshes[1].positions]).toEqual([7, 8, 9]);
    expect([...result.geometry.meshes[0].indices]).toEqual([0, 1, 1]);
  });

  it.each([[new ArrayBuffer(4)], [message(9, {})], [message(1, { rows: 100, columns: 100, mesh: 0 })]])("refuses what is no message", (buffer) => {
    expect(() => decode(buffer)).toThrow(RangeError);
  });
});
