// The surfels of the joint adjustment, as small squares in their planes.

import {
  Color, DoubleSide, InstancedMesh, Matrix4, MeshBasicMaterial, PlaneGeometry, Quaternion, Vector3,
} from 'three';

/** Share of the edge of a patch that is drawn: gaps separate the patches. */
const DRAWN = 0.86;

export class SurfelLayer {
  /** `surfels` are those of a drive; `colours` is a table of 256 colours for the bytes of their roughness. */
  constructor(surfels, colours) {
    const { points, positions, normals, sizesM, roughness } = surfels;
    const plane = new PlaneGeometry(DRAWN, DRAWN);
    const material = new MeshBasicMaterial({ side: DoubleSide, transparent: true, opacity: 0.75, depthWrite: false });
    this.object = new InstancedMesh(plane, material, points);
    this.object.frustumCulled = false;
    this.roughness = roughness;
    const up = new Vector3(0, 0, 1);
    const turn = new Quaternion();
    for (let i = 0; i < points; i++) {
      const normal = new Vector3(...normals.subarray(3 * i, 3 * i + 3)).normalize();
      turn.setFromUnitVectors(up, normal);
      const at = new Vector3(...positions.subarray(3 * i, 3 * i + 3));
      this.object.setMatrixAt(i, new Matrix4().compose(at, turn, new Vector3(sizesM[i], sizesM[i], 1)));
    }
    this.colour(colours);
  }

  colour(colours) {
    const colour = new Color();
    this.roughness.forEach((byte, i) => {
      const [r, g, b] = colours.subarray(4 * byte, 4 * byte + 3);
      this.object.setColorAt(i, colour.setRGB(r / 255, g / 255, b / 255, 'srgb'));
    });
    if (this.object.instanceColor) this.object.instanceColor.needsUpdate = true;
  }

  dispose() {
    this.object.removeFromParent();
    this.object.dispose();
    this.object.geometry.dispose();
    this.object.material.dispose();
  }
}
