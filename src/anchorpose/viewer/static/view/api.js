// Requests to the server. All addresses are relative: the token is part of the page's own.

const ARRAYS = {
  uint8: Uint8Array, uint16: Uint16Array, int16: Int16Array, int32: Int32Array, uint32: Uint32Array,
  float32: Float32Array, float64: Float64Array,
};
const up = (place) => place + ((8 - (place % 8)) % 8);

/** Arrays as views into the buffer, by name, and the meta; the counterpart of pack in payloads.py. */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(4, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const arrays = {};
  for (const { name, type, shape, start } of head.arrays) {
    const size = shape.reduce((product, side) => product * side, 1);
    arrays[name] = new ARRAYS[type](buffer, up(8 + length) + start, size);
    arrays[name].shape = shape;
  }
  return { meta: head.meta, arrays, bytes: buffer.byteLength };
}

async function checked(response) {
  if (response.ok) return response;
  const refusal = await response.json().catch(() => ({ error: `the viewer answered ${response.status}` }));
  throw new Error(refusal.error);
}

async function request(address, options) {
  let response;
  try {
    response = await fetch(address, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The viewer program does not answer. Was it stopped?");
  }
  return checked(response);
}

export const getJson = async (name) => (await request(name)).json();

export const getArrays = async (name, query = {}, signal = undefined) =>
  unpack(await (await request(`${name}?${new URLSearchParams(query)}`, { signal })).arrayBuffer());

export const postJson = async (name, body) =>
  (await request(name, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) })).json();
