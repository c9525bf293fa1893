// Browsers start no workers for pages that are opened from disk: let a frame do the search.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      this.ready = new Promise((resolve) => {
        const start = () => {
          document.body.append(frame);
          const inside = frame.contentWindow;
          inside.postMessage = (data) => this.tell("message", { data });
          const script = inside.document.createElement("script");
          script.onload = () => resolve(inside);
          script.src = new URL(url, location.href).href;
          inside.document.body.append(script);
        };
        if (document.body) start();
        else addEventListener("DOMContentLoaded", start);
      });
    }
    tell(type, init) {
      const event = new MessageEvent(type, init);
      this.dispatchEvent(event);
      this[`on${type}`]?.(event);
    }
    postMessage(data) {
      this.ready.then((inside) => inside.dispatchEvent(new MessageEvent("message", { data })));
    }
    terminate() {}
  };
}
