// The values of the probed pixel, in a panel of fixed size below the image.

import { box, button, setText } from "./dom.js";
import { count, number, percent, plain, quantity } from "./format.js";

/** @param {import("./store.js").Store} store */
export function probePanel(store) {
  const show = () => {
    const { pin, cursor, probe } = store;
    const place = pin ?? cursor;
    button("unpin").disabled = pin === null;
    setText(box("probe-place"), place ? `${place.x}, ${place.y}` : number(null));
    box("probe-place").style.fontWeight = pin ? "600" : "";
    setText(box("probe-value"), probe && probe.value !== null ? `${plain(probe.value, 5)} DN` : number(null));
    setText(box("probe-electrons"), quantity(probe?.electrons, "e⁻", 4));
    setText(box("probe-camera-sigma"), quantity(probe?.camera_sigma, "DN"));
    setText(box("probe-render-sigma"), quantity(probe?.render_sigma, "DN"));
    setText(box("probe-ratio"), number(probe?.ratio));
    setText(box("probe-samples"), count(probe?.samples));
    setText(box("probe-depth"), quantity(probe?.depth, "m", 4));
    setWithTitle(box("probe-object"), probe?.object ?? number(null));
    setWithTitle(box("probe-material"), probe?.material ?? number(null));
    setText(box("probe-heaviest"), probe?.heaviest
      ? `${percent(probe.heaviest.share)} of the value` : number(null));
    box("probe-heaviest").title = probe?.heaviest ? `Sample ${probe.heaviest.index}` : "";
  };
  store.on(["probe", "pin", "cursor"], show);
  button("unpin").addEventListener("click", () => store.setPin(null));
  show();
}

/**
 * Long names are cut, so the whole name is in the tooltip.
 * @param {HTMLElement} target
 * @param {string} text
 */
function setWithTitle(target, text) {
  setText(target, text);
  if (target.title !== text) target.title = text;
}
