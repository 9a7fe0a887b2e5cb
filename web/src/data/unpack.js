// The lists of a drive, as `crates/report/src/report/scene/packed.rs` writes them.

/** The bytes of base64 text. */
export function fromBase64(text) {
  const binary = atob(text.trim());
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** The bytes of a zlib stream. */
export async function inflate(deflated) {
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * A list of numbers: 8 bits as plain bytes; 16 and 32 bits as differences from one number to the next, all lowest bytes
 * first, then all next ones. Numbers of 32 bits are signed.
 */
export function list(bytes, { at, length, bits }) {
  if (bits === 8) return bytes.subarray(at, at + length);
  const values = bits === 16 ? new Uint16Array(length) : new Int32Array(length);
  let last = 0;
  for (let i = 0; i < length; i++) {
    let difference = 0;
    for (let plane = 0; plane < bits / 8; plane++) {
      difference |= bytes[at + plane * length + i] << (8 * plane);
    }
    last = (last + difference) | 0;
    values[i] = last; // modulo 2¹⁶ or 2³²
  }
  return values;
}
