"use strict";
(function () {
  var root = document.documentElement;
  var button = document.getElementById("theme");
  if (button) {
    button.addEventListener("click", function () {
      var dark = root.dataset.theme
        ? root.dataset.theme === "dark"
        : window.matchMedia("(prefers-color-scheme: dark)").matches;
      root.dataset.theme = dark ? "light" : "dark";
    });
  }
  var slider = document.querySelector(".slider");
  if (!slider) return;
  slider.classList.add("on");
  var stage = slider.querySelector(".stage");
  slider.querySelector("input").addEventListener("input", function (event) {
    stage.style.setProperty("--cut", event.target.value + "%");
  });
  slider.querySelectorAll("select").forEach(function (select) {
    var shown = document.getElementById(select.dataset.shows);
    var choose = function () {
      var picture = document.getElementById(select.value);
      shown.src = picture.src;
      shown.alt = picture.alt;
    };
    select.addEventListener("change", choose);
    choose();
  });
})();
