// Shades points by the depth of their neighbours on the screen (eye-dome lighting), which makes edges and surfaces of a
// cloud without normals visible.

import {
  BufferAttribute, BufferGeometry, DepthTexture, GLSL3, Mesh, NearestFilter, OrthographicCamera, Scene, ShaderMaterial,
  UnsignedIntType, Vector2, WebGLRenderTarget,
} from 'three';

/** How strongly a nearer neighbour darkens a point. */
const STRENGTH = 20;

const VERTEX = /* glsl */ `
void main() {
  gl_Position = vec4(position.xy, 0.0, 1.0);
}
`;

const FRAGMENT = /* glsl */ `
uniform sampler2D seen;
uniform highp sampler2D depths;
uniform vec2 ends;
uniform float reach;
out vec4 shown;

float logDepth(float depth) {
  return log2(ends.x * ends.y / (ends.y - depth * (ends.y - ends.x)));
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  ivec2 last = textureSize(depths, 0) - 1;
  float depth = texelFetch(depths, at, 0).r;
  float shade = 1.0;
  if (depth < 1.0) {
    float here = logDepth(depth);
    float sum = 0.0;
    for (int i = 0; i < 8; i++) {
      float angle = 0.785398 * float(i);
      ivec2 beside = clamp(at + ivec2(round(reach * vec2(cos(angle), sin(angle)))), ivec2(0), last);
      float other = texelFetch(depths, beside, 0).r;
      // A far edge in front counts no more than a near one.
      sum += clamp(here - logDepth(other), 0.0, 0.05);
    }
    shade = exp(-${STRENGTH.toFixed(1)} * sum / 8.0);
  }
  shown = vec4(texelFetch(seen, at, 0).rgb * shade, 1.0);
}
`;

export class Shading {
  constructor() {
    this.target = new WebGLRenderTarget(1, 1, { minFilter: NearestFilter, magFilter: NearestFilter });
    this.target.depthTexture = new DepthTexture(1, 1, UnsignedIntType);
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      depthTest: false,
      depthWrite: false,
      uniforms: {
        seen: { value: this.target.texture },
        depths: { value: this.target.depthTexture },
        ends: { value: new Vector2() },
        reach: { value: 1 },
      },
    });
    // One triangle that covers the view.
    const triangle = new BufferGeometry();
    triangle.setAttribute('position', new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const mesh = new Mesh(triangle, this.material);
    mesh.frustumCulled = false;
    this.scene = new Scene();
    this.scene.add(mesh);
    this.camera = new OrthographicCamera();
  }

  resize(renderer) {
    const size = renderer.getDrawingBufferSize(new Vector2());
    this.target.setSize(size.x, size.y);
    this.material.uniforms.reach.value = 1.4 * renderer.getPixelRatio();
  }

  render(renderer, scene, camera) {
    this.material.uniforms.ends.value.set(camera.near, camera.far);
    renderer.setRenderTarget(this.target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    renderer.render(this.scene, this.camera);
  }
}
