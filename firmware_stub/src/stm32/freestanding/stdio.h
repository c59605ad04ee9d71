/* pymavlink's headers include this and use nothing of it. */
