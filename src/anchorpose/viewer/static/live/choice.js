// Which angles are shown and where their targets lie, remembered by this browser.

const KEY = "anchorpose-live", MOST = 6;

const isNumber = (value) => typeof value === "number" && Number.isFinite(value);
const isChoice = (names) => (one) => names.includes(one?.angle) && isNumber(one.from) && isNumber(one.to);
const usual = (names) => ["knee_flexion_left", "knee_flexion_right"].filter((angle) => names.includes(angle))
  .map((angle) => ({ angle, from: 0, to: 10 }));

/** [{angle, from, to}], degrees. What was remembered and makes no sense is left out. */
export function remembered(names) {
  try {
    const held = JSON.parse(localStorage.getItem(KEY));
    if (Array.isArray(held)) return held.filter(isChoice(names)).slice(0, MOST);
  } catch { /* a browser may forbid its storage, and others may have written there */ }
  return usual(names);
}

export function remember(choices) {
  try {
    localStorage.setItem(KEY, JSON.stringify(choices));
  } catch { /* then it is not remembered */ }
}

export const isFull = (choices) => choices.length >= MOST;
