(function () {
  "use strict";
  var root = document.documentElement;
  var button = document.getElementById("theme");
  if (!button) return;
  button.addEventListener("click", function () {
    var dark = root.dataset.theme
      ? root.dataset.theme === "dark"
      : window.matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
})();
