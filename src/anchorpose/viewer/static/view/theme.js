// Colours: those of the style sheet, so that the page and the scene agree in light and in dark.

import { Color } from "three";

const read = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export const css = (name) => read(name);
export const colour = (name) => linear(read(name));
export const colours = (name) => read(name).split(",").map((text) => linear(text.trim()));

// our shaders write screen colours without a conversion
function linear(text) {
  const found = new Color();
  found.setStyle(text, "");
  return found;
}

/** Calls back at once and on each change between light and dark. */
export function themed(callback) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", callback);
  callback();
}
