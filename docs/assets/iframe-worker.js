// Search when the pages are opened as files: browsers allow no worker there, so the
// worker's script runs in a hidden frame, which answers the same messages.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.inner = frame.contentWindow;
      this.waiting = [];
      window.addEventListener("message", (event) => {
        if (event.source !== this.inner) return;
        const answer = new MessageEvent("message", { data: event.data });
        this.dispatchEvent(answer);
        if (this.onmessage) this.onmessage(answer);
      });
      frame.addEventListener("ready", () => this.send());
      const inside = frame.contentDocument;
      inside.open();
      inside.write(`<script>
        postMessage = (data) => parent.postMessage(data, "*");
        importScripts = (...urls) => Promise.all(urls.map((url) => new Promise((done) => {
          const script = document.createElement("script");
          script.src = url;
          script.onload = done;
          document.head.append(script);
        })));
      <\/script><script src="${url}"><\/script><script>
        frameElement.dispatchEvent(new Event("ready"));
      <\/script>`);
      inside.close();
    }

    postMessage(data) {
      this.waiting.push(data);
      if (this.isReady) this.send();
    }

    send() {
      this.isReady = true;
      for (const data of this.waiting.splice(0)) {
        this.inner.dispatchEvent(new MessageEvent("message", { data }));
      }
    }

    terminate() {}
  };
}
