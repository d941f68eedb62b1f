// The buttons, the slider and the clock below the scene; a page has those that it needs.

const element = (id) => document.getElementById(id);

/** inWords(): {clock, spoken} of the frame that is shown. */
export function transport(playback, inWords) {
  const scrub = element("scrub"), play = element("play");
  scrub.addEventListener("input", () => { playback.pause(); playback.seek(Number(scrub.value)); });
  const buttons = {
    first: () => playback.seek(playback.first), back: () => playback.step(-1), play: () => playback.toggle(),
    forward: () => playback.step(1), last: () => playback.seek(playback.last),
  };
  for (const [id, run] of Object.entries(buttons)) element(id)?.addEventListener("click", run);
  element("speed").addEventListener("change", (event) => playback.setSpeed(Number(event.target.value)));
  const show = () => {
    const { clock, spoken } = inWords();
    element("clock").textContent = clock;
    [scrub.min, scrub.max, scrub.value] = [playback.first, playback.last, playback.position];
    scrub.setAttribute("aria-valuetext", spoken);
  };
  const state = () => {
    play.classList.toggle("playing", playback.playing);
    play.setAttribute("aria-label", playback.playing ? "Pause" : "Play");
    element("speed").value = String(playback.speed);
  };
  playback.addEventListener("moved", show);
  playback.addEventListener("state", state);
  show();
}
