// Time upright, load on the feet, who and what touches the patient: numbers beside the dials. Inferred: hollow and with "~". Not known: "–".

const byId = (id) => document.getElementById(id);

export function clock(seconds) {
  const whole = Math.floor(seconds), minutes = Math.floor(whole / 60);
  return `${minutes}:${String(whole % 60).padStart(2, "0")}`;
}

/** message: of a frame; null where nothing is known now. The time upright so far stays: it does not change by that. */
export function showFacts(message) {
  if (message) byId("upright").textContent = clock(message.upright_s);
  const upright = message ? message.upright : null, sign = message?.upright_inferred ? "~ " : "";
  byId("upright-now").textContent = upright === null ? "now: –" : `${sign}now: ${upright ? "upright" : "not upright"}`;
  showLoad(message);
  showParts("touched", message ? message.touched : null, "nobody");
  showParts("holding", message ? message.holding : null, "nothing");
}

function showLoad(message) {
  const known = message !== null && message.load_left !== null, inferred = known && message.load_inferred;
  const sign = inferred ? "~" : "", left = known ? Math.round(100 * message.load_left) : null;
  byId("load").classList.toggle("inferred", inferred);
  byId("load-left").textContent = known ? `${sign}${left}` : "–";
  byId("load-right").textContent = known ? `${sign}${100 - left}` : "–";
  byId("load-note").textContent = known ? `% ± ${(196 * message.load_sigma).toFixed(0)}` : "";
  const mark = byId("load-bar").firstElementChild;
  mark.hidden = !known;
  if (known) mark.style.left = `${100 - left}%`;
}

function showParts(id, touched, none) {
  const parts = touched ? Object.entries(touched).map(([part, seen]) => word(part, seen)) : ["–"];
  byId(id).replaceChildren(...(touched && !parts.length ? [none] : parts.flatMap((part, i) => (i ? [", ", part] : [part]))));
}

function word(part, seen) {
  const name = part.replace(/^(.*)_(left|right)$/, "$2 $1").replaceAll("_", " ");
  const text = Object.assign(document.createElement("span"), { textContent: seen ? name : `~${name}` });
  if (!seen) text.className = "unseen";
  return text;
}
