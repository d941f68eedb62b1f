// What the server is asked. All addresses are relative: the token stands in the page's own.

const ARRAYS = {
  uint8: Uint8Array, uint16: Uint16Array, int16: Int16Array, int32: Int32Array, uint32: Uint32Array,
  float32: Float32Array, float64: Float64Array,
};
const up = (place) => place + ((8 - (place % 8)) % 8);

/** Arrays as views into the buffer, by name, and the meta; the counterpart of container.pack. */
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

async function checked(answer) {
  if (answer.ok) return answer;
  const told = await answer.json().catch(() => ({ error: `the viewer answered ${answer.status}` }));
  throw new Error(told.error);
}

async function ask(address, options) {
  let answer;
  try {
    answer = await fetch(address, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The viewer's program does not answer: was it stopped?");
  }
  return checked(answer);
}

export const getJson = async (name) => (await ask(name)).json();

export const getArrays = async (name, query = {}, signal = undefined) =>
  unpack(await (await ask(`${name}?${new URLSearchParams(query)}`, { signal })).arrayBuffer());

export const postJson = async (name, body) =>
  (await ask(name, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) })).json();
