/** The ultrasound image in place: the sector of the plane, textured with the pixels that are on the screen. */

import * as THREE from "three";
import { sector, type Point } from "../image/sector";
import type { Frame, ProbeOutline } from "../protocol";
import { toFrame, toWorld } from "../vec";

export class ImagePlane {
  readonly object: THREE.Mesh;
  readonly edge = new THREE.LineLoop(
    new THREE.BufferGeometry(),
    new THREE.LineBasicMaterial({ color: 0xaeb7c0, transparent: true, opacity: 0.75 }),
  );
  private texture: THREE.DataTexture | null = null;
  // a little behind itself, so that its edge is a whole line
  private readonly material = new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2 });
  private shape = "";

  constructor() {
    this.object = new THREE.Mesh(new THREE.BufferGeometry(), this.material);
    this.object.frustumCulled = this.edge.frustumCulled = false;
    this.object.add(this.edge);
    this.object.matrixAutoUpdate = false;
  }

  show({ header, pixels }: Frame, probe: ProbeOutline): void {
    const { rows, columns, pixel } = header;
    const key = [rows, columns, ...pixel, header.state.image.depth, ...origin(header)].join();
    if (key !== this.shape) {
      this.shape = key;
      this.rebuild(header, probe);
    }
    (this.texture?.image.data as Uint8Array).set(pixels);
    if (this.texture) this.texture.needsUpdate = true;
    this.object.matrix.set(...(header.image_to_reference as unknown as Parameters<THREE.Matrix4["set"]>));
    this.object.matrixWorldNeedsUpdate = true;
  }

  private rebuild(header: Frame["header"], probe: ProbeOutline): void {
    const { rows, columns, pixel } = header;
    const { face, deep, outline } = sector(probe, header.state.image.depth);
    const [ox, oy] = origin(header);
    const place = ([x, y]: Point): [number, number, number] => [x + ox, y + oy, 0];
    const upper = face.length === deep.length ? face : deep.map(() => face[0]);
    const vertices = [...upper, ...deep].map(place);
    const indices: number[] = [];
    for (let k = 0; k + 1 < deep.length; k += 1) {
      const below = k + deep.length;
      indices.push(k, below, k + 1, k + 1, below, below + 1);
    }
    const uv = vertices.flatMap(([x, y]) => [(x / pixel[0] + 0.5) / columns, (y / pixel[1] + 0.5) / rows]);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(vertices.flat(), 3));
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute(uv, 2));
    geometry.setIndex(indices);
    this.object.geometry.dispose();
    this.object.geometry = geometry;
    this.edge.geometry.dispose();
    this.edge.geometry = new THREE.BufferGeometry().setFromPoints(outline.map((p) => new THREE.Vector3(...place(p))));
    this.texture?.dispose();
    this.texture = new THREE.DataTexture(new Uint8Array(rows * columns), columns, rows, THREE.RedFormat);
    this.texture.unpackAlignment = 1;
    this.texture.minFilter = this.texture.magFilter = THREE.LinearFilter;
    grey(this.material, this.texture);
  }
}

/** One channel for all three. */
function grey(material: THREE.MeshBasicMaterial, texture: THREE.DataTexture): void {
  material.map = texture;
  material.onBeforeCompile = (shader) => {
    // grey values are display values: to linear here, since the renderer turns them back
    shader.fragmentShader = shader.fragmentShader.replace(
      "#include <map_fragment>",
      "diffuseColor.rgb *= pow(vec3(texture2D(map, vMapUv).r), vec3(2.2));",
    );
  };
  material.needsUpdate = true;
}

function origin(header: Frame["header"]): [number, number] {
  const [x, y] = toFrame(header.image_to_reference, toWorld(header.probe_to_reference, [0, 0, 0]));
  return [x, y];
}
