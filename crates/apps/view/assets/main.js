// The page: joins the parts and starts them.

import { followState, postJson } from "./api.js";
import { cameraPanel } from "./camera_panel.js";
import { button, byId, input } from "./dom.js";
import { closeNotes, header, nextTheme, pause } from "./header.js";
import { followKeys } from "./keys.js";
import { legend, stepOpacity } from "./legend.js";
import { measurePanel } from "./measure_panel.js";
import { Measurements } from "./measurements.js";
import { NoisePanel } from "./noise_panel.js";
import { Pictures } from "./pictures.js";
import { probePanel } from "./probe_panel.js";
import { Problems } from "./problems.js";
import { idle, Lane, tracked } from "./requests.js";
import { savePanel } from "./save_panel.js";
import { ScenePanel } from "./scene_panel.js";
import { drawShapes } from "./shapes.js";
import { Store } from "./store.js";
import { nextTone, stepMap, tabs, toolbar, togglePath } from "./toolbar.js";
import { followDivider, followPointer } from "./tools.js";
import { Viewer } from "./viewer.js";

const PAN_STEP = 60; // CSS pixels for each press of an arrow key

const store = new Store();
const problems = new Problems();
const viewer = new Viewer(byId("image", HTMLCanvasElement), store);
const redraw = () => viewer.invalidate();

/**
 * An action of the user: its fault is shown.
 * @param {string} path
 * @param {unknown} body
 * @returns {Promise<boolean>} true if the server accepted it
 */
function act(path, body) {
  return tracked(async () => {
    try {
      await postJson(path, body);
      problems.clear(path);
      return true;
    } catch (error) {
      problems.set(path, error);
      return false;
    }
  });
}

/**
 * @param {unknown} error
 * @param {string} key
 */
const report = (error, key) => problems.set(key, error);
const pictures = new Pictures(store, viewer, new Lane(report), problems);
const measurements = new Measurements(store, new Lane(report), problems);

header(store, act, problems);
toolbar(store, viewer);
cameraPanel(store, problems);
new ScenePanel(store, act, problems);
const noisePanel = new NoisePanel(store, problems, act);
const updateMeasures = measurePanel(store, measurements, problems);
probePanel(store);
savePanel(store, problems);
legend(store, pictures, redraw);
const chooseTab = tabs((tab) => {
  // The plots of hidden panels are not drawn, so they are drawn when a panel is shown.
  if (tab === "noise") noisePanel.show();
  if (tab === "measure") updateMeasures();
});
followPointer(viewer, store);
followDivider(store);
viewer.drawShapes = (/** @type {CanvasRenderingContext2D} */ context) => drawShapes(context, viewer, store);
store.on(["shapes", "pin", "path", "measures"], redraw);

/**
 * Moves the pinned pixel; the first press pins the pixel in the middle.
 * @param {number} dx
 * @param {number} dy
 */
function movePin(dx, dy) {
  const from = store.pin ?? store.cursor ?? store.clamp(viewer.centre());
  store.setPin({ x: from.x + dx, y: from.y + dy });
}

/** Saves the chosen files, and shows the panel with the result. */
function save() {
  const { activeElement } = document;
  const isInPanel = activeElement instanceof HTMLElement && activeElement.closest(".panel:not(#panel-save)") !== null;
  // A number that is being typed counts, and the focus must not stay in a panel that is hidden.
  if (isInPanel) activeElement.blur();
  chooseTab("save", isInPanel);
  button("save").click();
}

/** @param {number} step */
function moveDivider(step) {
  if (store.compare) store.setDivider(store.divider + step);
}

/**
 * @param {string} key
 * @param {number} dx
 * @param {number} dy
 */
const arrows = (key, dx, dy) => [
  { key, shift: false, text: "", run: () => viewer.pan(-dx * PAN_STEP, -dy * PAN_STEP) },
  { key, shift: true, text: "", run: () => movePin(dx, dy) },
];

followKeys([
  { key: "1", shown: "1 to 5", text: "panel Camera, Scene, Noise, Measure, Save", run: () => chooseTab("camera", true) },
  { key: "2", text: "", run: () => chooseTab("scene", true) },
  { key: "3", text: "", run: () => chooseTab("noise", true) },
  { key: "4", text: "", run: () => chooseTab("measure", true) },
  { key: "5", text: "", run: () => chooseTab("save", true) },
  { key: "f", shown: "F", text: "whole image", run: () => viewer.fit() },
  { key: "z", shown: "Z", text: "1:1, one pixel on one pixel", run: () => viewer.zoomTo(1) },
  { key: "+", shown: "+ -", text: "zoom", run: () => viewer.zoomStep(1) },
  { key: "=", text: "", run: () => viewer.zoomStep(1) },
  { key: "-", text: "", run: () => viewer.zoomStep(-1) },
  ...arrows("ArrowLeft", -1, 0), ...arrows("ArrowRight", 1, 0),
  ...arrows("ArrowUp", 0, -1), ...arrows("ArrowDown", 0, 1),
  { key: "arrows", shown: "arrows", text: "move the image", run: () => {} },
  { key: "arrows", shown: "Shift+arrows", text: "move the pinned pixel", run: () => {} },
  { key: "Enter", text: "pin the pixel under the cursor or in the middle", run: () => movePin(0, 0) },
  { key: "Escape", text: "close the notes, remove the pin", run: () => closeNotes() || store.setPin(null) },
  { key: "t", shown: "T", text: "next tone curve", run: () => nextTone(store) },
  { key: "m", shown: "M", shift: false, text: "next map", run: () => stepMap(store, 1) },
  { key: "m", shown: "Shift+M", shift: true, text: "previous map", run: () => stepMap(store, -1) },
  { key: "o", shown: "O", text: "opacity of the map", run: () => stepOpacity(store, redraw) },
  { key: "c", shown: "C", text: "compare A and B", run: () => store.setCompare(!store.compare) },
  { key: "k", shown: "K", text: "keep the settings as B", run: () => store.keep() },
  { key: "x", shown: "X", text: "exchange A and B", run: () => store.swap() },
  { key: "[", shown: "[ ]", text: "move the line between A and B", run: () => moveDivider(-0.05) },
  { key: "]", text: "", run: () => moveDivider(0.05) },
  { key: "l", shown: "L", text: "live view on or off", run: () => store.setLive(!store.live) },
  { key: "n", shown: "N", text: "next frame of the camera", run: () => store.stepFrame() },
  { key: "e", shown: "E", text: "automatic exposure on or off", run: () => input("exposure-auto").click() },
  { key: ",", shown: ", .", text: "target k down or up", run: () => noisePanel.stepTarget(-1) },
  { key: ".", text: "", run: () => noisePanel.stepTarget(1) },
  { key: "p", shown: "P", text: "pause or continue the render", run: () => pause(store, act) },
  { key: "v", shown: "V", text: "tool: move", run: () => store.setTool("move") },
  { key: "r", shown: "R", shift: false, text: "tool: region 1", run: () => store.setTool("region1") },
  { key: "r", shown: "Shift+R", shift: true, text: "tool: region 2", run: () => store.setTool("region2") },
  { key: "i", shown: "I", text: "tool: line profile", run: () => store.setTool("line") },
  { key: "h", shown: "H", text: "light path of the heaviest sample", run: () => togglePath(store) },
  { key: "d", shown: "D", text: "colours: system, light, dark", run: nextTheme },
  // The keys below have another place in the code; they are here for the list.
  { key: "save", shown: "Ctrl+S", text: "save the chosen files", run: () => {} },
], save);

followState((state) => store.setServer(state), (connected) => store.setConnected(connected));

window.dunkelfeld = {
  get state() {
    return store.server;
  },
  frame: () => store.frameA,
  idle,
};
