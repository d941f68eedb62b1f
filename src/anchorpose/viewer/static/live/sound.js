// A short tone when a target is reached, on request: browsers allow sound only after a click.

const LEAST_MS = 1000; // an angle at the edge of its target goes in and out of it

export class Sound {
  constructor(button) {
    this.button = button;
    this.on = false;
    this.played = 0;
    this.last = -Infinity;
    button.addEventListener("click", () => this.toggle());
  }

  toggle() {
    this.on = !this.on;
    this.button.setAttribute("aria-pressed", String(this.on));
    if (this.on) (this.context ??= new AudioContext()).resume();
  }

  play() {
    const now = performance.now();
    if (!this.on || now - this.last < LEAST_MS) return;
    this.last = now;
    this.played += 1;
    const begin = this.context.currentTime, tone = this.context.createOscillator(), volume = this.context.createGain();
    tone.frequency.setValueAtTime(660, begin);
    tone.frequency.setValueAtTime(880, begin + 0.12);
    volume.gain.setValueAtTime(0.25, begin);
    volume.gain.exponentialRampToValueAtTime(0.001, begin + 0.4);
    tone.connect(volume).connect(this.context.destination);
    tone.start(begin);
    tone.stop(begin + 0.4);
  }
}
