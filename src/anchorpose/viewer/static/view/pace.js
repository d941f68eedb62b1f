// Keeps playing smooth: where drawing takes too long, a part of the points is left out until it is paused.

const SLOW_MS = 36, FAST_MS = 20, PATIENCE = 6, LEAST = 1 / 16;

export class Pace {
  /** detail(share): draws that share of the points. */
  constructor(playback, detail) {
    Object.assign(this, { playback, detail, share: 1, before: null, slow: 0, fast: 0 });
    playback.addEventListener("state", () => this.change(playback.playing ? this.playing ?? 1 : 1));
  }

  change(share) {
    this.slow = this.fast = 0;
    this.before = null;
    if (share === this.share) return;
    this.share = share;
    this.detail(share);
  }

  /** Called with the time of each drawing. */
  tick(now) {
    const took = this.before === null ? null : now - this.before;
    this.before = now;
    if (!this.playback.playing || took === null) return;
    this.slow = took > SLOW_MS ? this.slow + 1 : 0;
    this.fast = took < FAST_MS ? this.fast + 1 : 0;
    if (this.slow >= PATIENCE && this.share > LEAST) this.change(this.playing = this.share / 2);
    else if (this.fast >= 30 * PATIENCE && this.share < 1) this.change(this.playing = this.share * 2);
  }
}
