#!/bin/sh
# Stands for a decode worker that a file breaks: hangs, crashes or talks nonsense when the file's name says so.
echo '"Ready"'
while read -r request; do
    case "$request" in
        *hang*) exec sleep 600 ;;
        *crash*) kill -SEGV $$ ;;
        *nonsense*) echo '{"Pardon":1}' ;;
        *) echo '{"Header":{"parts":[{"name":"","channels":[{"name":"R","sample":"F16"}],
            "data":{"x":0,"y":0,"width":3,"height":2},"display":{"x":0,"y":0,"width":3,"height":2}}]}}' | tr -d '\n'
           echo ;;
    esac
done
