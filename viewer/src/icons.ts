// Icons of the buttons: strokes on a grid of 20.

const svg = (body: string) =>
  `<svg viewBox="0 0 20 20" width="18" height="18" fill="none" stroke="currentColor" stroke-width="1.6" stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${body}</svg>`;

export const ICONS = {
  play: svg('<path d="M6.5 4.2v11.6L16 10z" fill="currentColor"/>'),
  pause: svg('<path d="M6.5 4.5v11M13.5 4.5v11" stroke-width="3"/>'),
  first: svg('<path d="M5 4.5v11M15 4.8v10.4L8 10z" fill="currentColor"/>'),
  loop: svg('<path d="M15.5 7.5A6 6 0 0 0 4.6 7.2M4.5 12.5a6 6 0 0 0 10.9.3M15.8 3.8v3.8h-3.8M4.2 16.2v-3.8H8"/>'),
  labels: svg('<path d="M3 4h8l6 6-7 7-7-7zM6.8 7.8h.01"/>'),
  joints: svg('<circle cx="10" cy="10" r="6.5"/><circle cx="10" cy="10" r="2.2" fill="currentColor"/>'),
  forces: svg('<path d="M4 16 15.5 4.5M9 4.5h6.5V11"/>'),
  trails: svg('<path d="M3 15c3-9 6 3 9-5 1-2.600 2.500-4 5-5" stroke-dasharray="2.500 2.600"/>'),
  axes: svg('<path d="M6 14V4M6 14h10M6 14l-3 3.500M4 6l2-2.500L8 6M14 12l2.500 2-2.500 2"/>'),
  follow: svg('<circle cx="10" cy="10" r="4.500"/><path d="M10 2.500v4M10 13.500v4M2.500 10h4M13.500 10h4"/>'),
  theme: svg('<path d="M16.500 11.800A7 7 0 0 1 8.200 3.500a7 7 0 1 0 8.300 8.300z"/>'),
  help: svg('<path d="M7.300 7.200a2.800 2.800 0 1 1 4 3c-.9.500-1.300 1-1.300 2M10 15.300v.01"/>'),
  panel: svg('<rect x="3" y="4" width="14" height="12" rx="1.500"/><path d="M12 4v12"/>'),
  fit: svg('<path d="M3.500 7.500v-4h4M12.500 3.500h4v4M16.500 12.500v4h-4M7.500 16.500h-4v-4"/>'),
};
