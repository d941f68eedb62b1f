// The stretch of time that curves and timeline show: all of it, or a window that follows the play head.

export class Axis extends EventTarget {
  constructor(times, playback) {
    super();
    this.times = times;
    this.playback = playback;
    this.span = 0;
    this.from = times[0];
    this.to = Math.max(times[times.length - 1], times[0] + 0.001);
    playback.addEventListener("moved", () => this.follow());
  }

  setSpan(seconds) {
    this.span = seconds;
    this.from = Infinity;
    this.follow();
  }

  /** Moves the window on when the play head leaves it. */
  follow() {
    const first = this.times[0], last = Math.max(this.times[this.times.length - 1], first + 0.001);
    const now = this.times[this.playback.position];
    let from = first, to = last;
    if (this.span && this.span < last - first) {
      if (now >= this.from && now <= this.to && this.to - this.from <= this.span + 1e-9) return;
      from = Math.max(first, Math.min(last - this.span, first + Math.floor((now - first) / this.span) * this.span));
      to = from + this.span;
    }
    if (from === this.from && to === this.to) return;
    this.from = from;
    this.to = to;
    this.dispatchEvent(new Event("changed"));
  }

  share(time) { return (time - this.from) / (this.to - this.from); }
  time(share) { return this.from + Math.min(1, Math.max(0, share)) * (this.to - this.from); }

  /** First and last frame to draw. */
  range() {
    return [Math.max(0, this.playback.rowBefore(this.from)), Math.min(this.times.length - 1, this.playback.rowBefore(this.to) + 1)];
  }
}

/** The context of a canvas, in CSS pixels, sharp on every screen. */
export function prepared(canvas, height) {
  const ratio = Math.min(devicePixelRatio, 2), width = canvas.clientWidth;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}

/** Press and drag on a canvas moves the play head. left: where its time axis begins. */
export function seekable(canvas, axis, playback, left) {
  const seek = (event) => {
    const box = canvas.getBoundingClientRect();
    playback.pause();
    playback.seekTime(axis.time((event.clientX - box.left - left) / (box.width - left)));
  };
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); seek(event); });
  canvas.addEventListener("pointermove", (event) => { if (canvas.hasPointerCapture(event.pointerId)) seek(event); });
}
