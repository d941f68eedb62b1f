// Asks for the reason where one is needed, and once per session for the reviewer's initials.

export class Signing {
  constructor(dialog, who) {
    this.dialog = dialog;
    this.reason = dialog.querySelector("#sign-reason");
    this.name = dialog.querySelector("#sign-who");
    this.name.value = sessionStorage.getItem("who") ?? who;
    dialog.querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      if ((this.reason.value.trim() || !this.reason.required) && this.name.value.trim()) dialog.close("saved");
    });
  }

  get who() { return this.name.value.trim(); }

  /** {reason, who}, or null where the dialog is cancelled. */
  ask(title, reasonNeeded = true) {
    if (!reasonNeeded && this.who) return Promise.resolve({ reason: "", who: this.who });
    this.dialog.querySelector("#sign-title").textContent = title;
    this.reason.value = "";
    this.reason.required = reasonNeeded;
    this.reason.parentElement.hidden = !reasonNeeded;
    this.dialog.returnValue = "";
    this.dialog.showModal();
    (reasonNeeded ? this.reason : this.name).focus();
    return new Promise((resolve) => {
      this.dialog.addEventListener("close", () => {
        if (this.dialog.returnValue !== "saved") return resolve(null);
        sessionStorage.setItem("who", this.who);
        return resolve({ reason: this.reason.value.trim(), who: this.who });
      }, { once: true });
    });
  }
}
