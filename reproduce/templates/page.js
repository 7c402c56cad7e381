for (const movie of document.querySelectorAll(".movie")) {
  const svg = movie.querySelector("svg");
  const controls = movie.querySelector(".controls");
  const [button, slider, output] = controls.children;
  const seconds = Number(movie.dataset.seconds);
  const motion = Number(movie.dataset.motion);
  const speed = motion / (seconds - Number(movie.dataset.rest));
  let playing = true;
  const show = (playingNow) => {
    playing = playingNow;
    button.textContent = playing ? "❚❚" : "▶";
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
    if (playing) svg.unpauseAnimations(); else svg.pauseAnimations();
  };
  const follow = () => {
    const now = Math.min((svg.getCurrentTime() % seconds) * speed, motion);
    if (playing) slider.value = String((1000 * now) / motion);
    output.textContent = `${now.toFixed(1)} s`;
    requestAnimationFrame(follow);
  };
  button.addEventListener("click", () => show(!playing));
  slider.addEventListener("input", () => {
    show(false);
    svg.setCurrentTime((Number(slider.value) / 1000) * (motion / speed));
  });
  controls.hidden = false;
  show(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  follow();
}
