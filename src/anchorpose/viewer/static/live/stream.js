// The events of the server, and whether they still come: a frame that is old must not stay on the screen.

export const STALL_S = 2;

/**
 * Dispatches "frame" (detail: the message), "sentence" (detail: text) and "silent" (detail: why nothing is known now).
 * "silent" comes again as the seconds go by.
 */
export class Stream extends EventTarget {
  constructor(address) {
    super();
    this.began = this.heard = performance.now();
    this.connected = this.ended = this.running = false; // running: a frame has come
    this.sentence = ""; // that came after the newest frame: it says why no other one came
    this.source = new EventSource(address);
    this.source.addEventListener("open", () => { this.connected = true; });
    this.source.addEventListener("error", () => { this.connected = false; this.check(); });
    this.source.addEventListener("frame", (event) => this.take(JSON.parse(event.data)));
    this.source.addEventListener("sentence", (event) => {
      this.sentence = JSON.parse(event.data);
      this.pass("sentence", this.sentence);
    });
    this.source.addEventListener("end", () => {
      this.ended = true;
      this.source.close();
      this.check();
    });
    setInterval(() => this.check(), 250);
  }

  take(message) {
    this.connected = this.running = true;
    this.sentence = "";
    this.heard = performance.now();
    this.pass("frame", message);
  }

  check() {
    const why = this.why();
    if (why) this.pass("silent", why);
  }

  why() {
    if (this.ended) return "The session has ended.";
    if (!this.connected) return "The connection is lost. Trying again.";
    const seconds = Math.floor((performance.now() - this.heard) / 1000);
    if (!this.running || seconds < STALL_S) return "";
    return this.sentence ? `${this.sentence} (no image for ${seconds} s)` : `No image for ${seconds} s`;
  }

  pass(name, detail) { this.dispatchEvent(new CustomEvent(name, { detail })); }
}
