// The values of the probed pixel, in a panel of fixed size below the image.

import { box, button, setText, show } from "./dom.js";
import { count, number, percent, plain, quantity } from "./format.js";

/** @param {import("./store.js").Store} store */
export function probePanel(store) {
  const update = () => {
    const { pin, cursor, probe } = store;
    const place = pin ?? cursor;
    button("unpin").disabled = pin === null;
    setText(box("probe-place"), place ? `${place.x}, ${place.y}` : number(null));
    box("probe-place").style.fontWeight = pin ? "600" : "";
    const saturation = store.sensorOf(store.camera)?.saturation ?? Infinity;
    const isBeyond = probe !== null && probe.electrons !== null && probe.electrons > saturation;
    // The header of the frame has the grey value of saturation, which need not be an integer.
    const white = store.frameA?.header.white ?? Infinity;
    const isSaturated = isBeyond || (probe !== null && probe.value !== null && probe.value >= Math.floor(white));
    const { dataset } = box("probe");
    dataset["saturated"] = String(isSaturated);
    // Until its answer arrives, the values are those of the pixel before.
    dataset["old"] = String(probe !== null && place !== null && (probe.x !== place.x || probe.y !== place.y));
    setText(box("probe-value"), probe && probe.value !== null ? `${plain(probe.value, 5)} DN` : number(null));
    setText(box("probe-electrons-name"), isBeyond ? "Before saturation" : "Electrons");
    setText(box("probe-electrons"), quantity(probe?.electrons, "e⁻", 4));
    setText(box("probe-camera-sigma"), isSaturated ? number(null) : quantity(probe?.camera_sigma, "DN"));
    setText(box("probe-render-sigma"), isSaturated ? number(null) : quantity(probe?.render_sigma, "DN"));
    setText(box("probe-ratio"), isSaturated ? "saturated" : number(probe?.ratio));
    setText(box("probe-channel"), probe?.channel ?? number(null));
    show(box("probe-channel-cell"), store.sensorOf(store.camera)?.colour ?? false);
    setText(box("probe-samples"), count(probe?.samples));
    setText(box("probe-depth"), quantity(probe?.depth, "m", 4));
    setWithTitle(box("probe-object"), probe?.object ?? number(null));
    setWithTitle(box("probe-material"), probe?.material ?? number(null));
    setText(box("probe-heaviest"), probe?.heaviest
      ? `${percent(probe.heaviest.share)} of the value` : number(null));
    box("probe-heaviest").title = probe?.heaviest ? `Sample ${probe.heaviest.index}` : "";
  };
  store.on(["probe", "pin", "cursor", "camera"], update);
  button("unpin").addEventListener("click", () => store.setPin(null));
  update();
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
