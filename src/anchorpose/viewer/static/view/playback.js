// Time: plays at recorded speed by the timestamps of the recording; frames that cannot be shown in time are skipped.

export class Playback extends EventTarget {
  constructor(times) {
    super();
    this.times = times;
    [this.first, this.last] = [0, times.length - 1];
    this.position = 0;
    this.playing = false;
    this.direction = 1;
    this.speed = 1;
  }

  /** Shows nothing before and after these frames from now on, and begins with the first. */
  limit(first, last) {
    [this.first, this.last, this.position] = [first, last, first];
    this.started = null;
    this.dispatchEvent(new Event("moved"));
  }

  seek(position) {
    const wanted = Math.min(this.last, Math.max(this.first, Math.round(position)));
    this.started = null;
    if (wanted === this.position) return;
    this.position = wanted;
    this.dispatchEvent(new Event("moved"));
  }

  /** The frame nearest to a time. */
  at(time) {
    const row = this.rowBefore(time);
    return row < this.last && this.times[row + 1] - time < time - this.times[row] ? row + 1 : row;
  }

  seekTime(time) { this.seek(this.at(time)); }

  step(count) { this.pause(); this.seek(this.position + count); }

  play(direction = 1) {
    const [start, end] = direction > 0 ? [this.first, this.last] : [this.last, this.first];
    if (this.position === end) this.seek(start);
    this.playing = true;
    this.direction = direction;
    this.started = null;
    this.dispatchEvent(new Event("state"));
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.dispatchEvent(new Event("state"));
  }

  toggle() { if (this.playing) this.pause(); else this.play(this.direction); }

  setSpeed(speed) { this.speed = speed; this.started = null; this.dispatchEvent(new Event("state")); }

  /** Called before each drawing with the time of the page in milliseconds. */
  tick(now) {
    if (!this.playing) return;
    if (!this.started) this.started = { now, time: this.times[this.position] };
    const passed = ((now - this.started.now) / 1000) * this.speed * this.direction;
    const row = this.rowBefore(this.started.time + passed, this.direction);
    if (row !== this.position) {
      this.position = row;
      this.dispatchEvent(new Event("moved"));
    }
    if (row === (this.direction > 0 ? this.last : this.first)) this.pause();
  }

  /** The last frame not after a time; backwards the first not before it. */
  rowBefore(time, direction = 1) {
    let low = this.first, high = this.last;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.times[middle] <= time + 1e-9) low = middle; else high = middle - 1;
    }
    return direction < 0 && low < this.last && this.times[low] < time - 1e-9 ? low + 1 : low;
  }
}

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
