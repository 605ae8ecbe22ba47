#!/bin/sh
# A double click in macOS's Finder starts the app in a browser; its window of Terminal stays and shows what went wrong.
exec "$(dirname -- "$0")/app" "$@"
