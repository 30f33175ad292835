"use strict";
(() => {
  for (const slider of document.querySelectorAll(".slider")) {
    const range = slider.querySelector("input[type=range]");
    if (!range) continue;
    const show = () => {
      slider.style.setProperty("--split", range.value + "%");
      for (const [tag, hidden] of [["before", range.value < 12], ["after", range.value > 88]]) {
        const label = slider.querySelector(".tag." + tag);
        if (label) label.style.opacity = hidden ? 0 : 1;
      }
    };
    range.addEventListener("input", show);
    show();
  }

  const map = document.getElementById("map");
  for (const button of map ? map.querySelectorAll("[data-layer]") : []) {
    button.addEventListener("click", () => {
      const shown = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", shown);
      for (const layer of map.querySelectorAll("svg ." + button.dataset.layer)) layer.style.display = shown ? "" : "none";
      for (const legend of map.querySelectorAll("[data-of=" + button.dataset.layer + "]")) legend.hidden = !shown;
    });
  }

  const copy = document.querySelector(".command .copy");
  if (copy && navigator.clipboard) {
    copy.hidden = false;
    copy.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(copy.parentElement.querySelector("code").textContent);
        copy.textContent = "Copied";
      } catch {
        copy.textContent = "Select it and copy it by hand";
      }
    });
  }

  const data = document.getElementById("frames");
  const viewer = document.getElementById("viewer");
  if (!data || !viewer) return;
  const frames = JSON.parse(data.textContent);
  const slider = viewer.querySelector(".slider");
  const part = (name) => viewer.querySelector(name);
  const [left, right, overlay, scrub, count, film, play] = [
    ".left", ".right", ".overlay", ".scrub", ".count", ".film", ".play",
  ].map(part);
  const afterTag = part(".tag.after");
  const modes = [...viewer.querySelectorAll("[data-mode]")];
  const legends = [...viewer.querySelectorAll("[data-legend]")];
  let current = 0, mode = modes.length ? modes[0].dataset.mode : "", regions = false, timer = 0;

  const pictureOf = (frame) => frame[mode] || frame.before;
  const show = (index, follow) => {
    current = (index + frames.length) % frames.length;
    const frame = frames[current];
    left.src = frame.before;
    right.src = pictureOf(frame);
    overlay.hidden = !(regions && frame.regions);
    if (!overlay.hidden) overlay.src = frame.regions;
    scrub.value = current;
    scrub.setAttribute("aria-valuetext", "frame " + frame.name);
    count.textContent = frame.label + "  ·  " + (current + 1) + " / " + frames.length;
    [...film.children].forEach((button, i) => button.setAttribute("aria-current", i === current));
    const chosen = film.children[current];
    if (follow && chosen) {
      film.scrollTo({ left: chosen.offsetLeft - film.offsetLeft - (film.clientWidth - chosen.clientWidth) / 2 });
    }
  };
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    play.textContent = "Play";
    play.setAttribute("aria-pressed", "false");
  };

  frames.forEach((frame, i) => {
    const button = document.createElement("button");
    const image = document.createElement("img");
    button.type = "button";
    button.title = frame.name;
    button.setAttribute("aria-label", "frame " + frame.name);
    image.alt = "";
    image.src = frame[mode] || frame.before;
    button.append(image);
    button.addEventListener("click", () => { stop(); show(i, false); });
    film.append(button);
  });
  scrub.max = frames.length - 1;
  scrub.addEventListener("input", () => { stop(); show(+scrub.value, true); });
  play.addEventListener("click", () => {
    if (timer) return stop();
    play.textContent = "Pause";
    play.setAttribute("aria-pressed", "true");
    timer = setInterval(() => show(current + 1, true), 160);
  });
  for (const button of modes) {
    button.addEventListener("click", () => {
      mode = button.dataset.mode;
      for (const other of modes) other.setAttribute("aria-pressed", other === button);
      for (const legend of legends) legend.hidden = legend.dataset.legend !== mode;
      if (afterTag) afterTag.textContent = button.textContent;
      show(current, false);
    });
  }
  const toggle = viewer.querySelector(".regions");
  const legend = viewer.querySelector(".legend.of-regions");
  if (toggle) {
    toggle.addEventListener("click", () => {
      regions = !regions;
      toggle.setAttribute("aria-pressed", regions);
      if (legend) legend.hidden = !regions;
      show(current, false);
    });
  }
  if (frames.length < 2) {
    for (const element of [film, play, scrub]) element.hidden = true;
  }
  slider.hidden = false;
  show(+viewer.dataset.first || 0, true);
})();
