/* What scrolls sideways is reached by keyboard; the theme's code buttons are no landmarks. */
(() => {
  const wide = ".md-typeset__scrollwrap, .formula, .md-typeset p:has(> img.wide), .md-typeset pre > code";
  let asked = false;
  const mend = () => {
    asked = false;
    for (const each of document.querySelectorAll(wide)) {
      if (each.scrollWidth > each.clientWidth) each.tabIndex = 0;
      else each.removeAttribute("tabindex");
    }
    for (const each of document.querySelectorAll("nav.md-code__nav")) each.setAttribute("role", "none");
  };
  const ask = () => {
    if (!asked) requestAnimationFrame(mend);
    asked = true;
  };
  new MutationObserver(ask).observe(document.body, { childList: true, subtree: true });
  addEventListener("resize", ask);
  ask();
})();
