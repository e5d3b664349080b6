/** Tissue surface, organs and the deforming grid: rest positions once, then positions as they come. */

import * as THREE from "three";
import type { Geometry, MeshHeader } from "../protocol";
import { cividis, roundUp } from "./cividis";

interface Part {
  info: MeshHeader;
  rest: Float32Array;
  object: THREE.Mesh | THREE.LineSegments;
  plain: THREE.Color;
}

export const GRID = "grid";
/** How much of what is missing to opaque a rim gains. */
const RIM = 0.55;

export class TissueModel {
  readonly group = new THREE.Group();
  /** mm at the top of the colour scale. */
  top = 1;
  private parts: Part[] = [];
  private colours = false;

  build(geometry: Geometry): void {
    this.clear();
    for (const [k, { info, positions, indices }] of geometry.meshes.entries()) {
      this.parts.push(this.part(info, positions.slice(), indices.slice(), k));
    }
    this.group.add(...this.parts.map(({ object }) => object));
  }

  /** New positions of all parts in order; without the grid where it was not asked for. */
  move(positions: Float32Array, withGrid: boolean): void {
    let at = 0;
    for (const part of this.parts) {
      if (part.info.name === GRID && !withGrid) continue;
      const attribute = part.object.geometry.getAttribute("position") as THREE.BufferAttribute;
      const size = attribute.array.length;
      (attribute.array as Float32Array).set(positions.subarray(at, at + size));
      attribute.needsUpdate = true;
      if (part.info.kind === "surface") part.object.geometry.computeVertexNormals();
      at += size;
    }
    if (this.colours) this.paint();
  }

  showGrid(on: boolean): void {
    for (const { info, object } of this.parts) if (info.name === GRID) object.visible = on;
  }

  showColours(on: boolean): void {
    this.colours = on;
    for (const { object, plain, info } of this.parts) {
      if (info.kind !== "surface") continue;
      const material = object.material as THREE.MeshPhongMaterial;
      material.vertexColors = on;
      material.color.copy(on ? new THREE.Color(0xffffff) : plain);
      material.needsUpdate = true;
    }
    if (on) this.paint();
  }

  private part(info: MeshHeader, rest: Float32Array, indices: Uint32Array, order: number): Part {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(rest.slice(), 3).setUsage(THREE.DynamicDrawUsage));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(rest.length).fill(1), 3));
    geometry.setIndex(new THREE.BufferAttribute(indices, 1));
    const plain = new THREE.Color(info.colour);
    const object = info.kind === "lines" ? lines(geometry, info) : surface(geometry, info);
    object.frustumCulled = false;
    object.visible = info.name !== GRID;
    // see-through layers after what they hide, outermost last
    object.renderOrder = info.opacity < 1 ? 100 - order : 0;
    return { info, rest, object, plain };
  }

  private paint(): void {
    let largest = 0;
    const surfaces = this.parts.filter(({ info }) => info.kind === "surface");
    const sizes = surfaces.map(({ rest, object }) => {
      const now = object.geometry.getAttribute("position").array as Float32Array;
      const size = new Float32Array(rest.length / 3);
      for (let k = 0; k < size.length; k += 1) {
        const [x, y, z] = [now[3 * k] - rest[3 * k], now[3 * k + 1] - rest[3 * k + 1], now[3 * k + 2] - rest[3 * k + 2]];
        size[k] = Math.sqrt(x * x + y * y + z * z);
        largest = Math.max(largest, size[k]);
      }
      return size;
    });
    // a scale that jumps with every step cannot be read
    const wanted = roundUp(largest);
    if (wanted > this.top || largest < 0.3 * this.top) this.top = wanted;
    for (const [k, { object }] of surfaces.entries()) {
      const colour = object.geometry.getAttribute("color") as THREE.BufferAttribute;
      const array = colour.array as Float32Array;
      for (let v = 0; v < sizes[k].length; v += 1) cividis(sizes[k][v] / this.top, array, 3 * v);
      for (let c = 0; c < array.length; c += 1) array[c] = array[c] ** 2.2;
      colour.needsUpdate = true;
    }
  }

  clear(): void {
    for (const { object } of this.parts) {
      object.geometry.dispose();
      (object.material as THREE.Material).dispose();
    }
    this.group.clear();
    this.parts = [];
    this.top = 1;
  }
}

function surface(geometry: THREE.BufferGeometry, info: MeshHeader): THREE.Mesh {
  geometry.computeVertexNormals();
  const material = new THREE.MeshPhongMaterial({
    color: info.colour,
    specular: 0x383838,
    shininess: 26,
    opacity: info.opacity,
    transparent: info.opacity < 1,
    depthWrite: info.opacity >= 1,
    side: THREE.DoubleSide,
  });
  if (info.opacity < 1) material.onBeforeCompile = thickenRim;
  return new THREE.Mesh(geometry, material);
}

/** What is seen through is thicker where it is looked at aslant: the rim tells the shape. */
function thickenRim(shader: { fragmentShader: string }): void {
  const rim = `float rim = 1.0 - abs(dot(normalize(normal), normalize(vViewPosition)));
    diffuseColor.a = mix(diffuseColor.a, 1.0, ${RIM.toFixed(2)} * rim * rim);
    #include <opaque_fragment>`;
  shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>", rim);
}

function lines(geometry: THREE.BufferGeometry, info: MeshHeader): THREE.LineSegments {
  const material = new THREE.LineBasicMaterial({ color: info.colour, opacity: info.opacity, transparent: info.opacity < 1, depthWrite: false });
  return new THREE.LineSegments(geometry, material);
}
